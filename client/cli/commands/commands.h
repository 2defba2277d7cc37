// The subcommands. Each adds itself to the app; its callback sets `exit_code`: 0 done, 1 a job failed, 2 an option is
// wrong, StoppedExitCode if the user stopped it.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace voxelpipe::cli {

// For options where an empty text (an unset shell variable) would silently mean something else.
inline std::string RefuseEmpty(const std::string& text) {
  return text.empty() ? "must not be empty" : "";
}

void AddBatchCommand(CLI::App& app, int& exit_code);
void AddBenchCommand(CLI::App& app, int& exit_code);
void AddCompareCommand(CLI::App& app, int& exit_code);
// These read `app` when they run: all commands are there then.
void AddCompletionCommand(CLI::App& app, int& exit_code);
void AddManualCommand(CLI::App& app, int& exit_code);
void AddVoxelizeCommand(CLI::App& app, int& exit_code);
void AddInfoCommand(CLI::App& app, int& exit_code);
void AddShadersCommand(CLI::App& app, int& exit_code);
void AddServerInfoCommand(CLI::App& app, int& exit_code);

}  // namespace voxelpipe::cli
