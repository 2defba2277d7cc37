// The subcommands. Each adds itself to the app; its callback sets `exit_code`: 0 done, 1 a job failed, 2 an option is
// wrong, 128 + signal where the user stopped it.
#pragma once

#include <CLI/CLI.hpp>

namespace voxelpipe::cli {

void AddVoxelizeCommand(CLI::App& app, int& exit_code);
void AddInfoCommand(CLI::App& app, int& exit_code);
void AddShadersCommand(CLI::App& app, int& exit_code);
void AddServerInfoCommand(CLI::App& app, int& exit_code);

}  // namespace voxelpipe::cli
