// The subcommands. Each adds itself to the app; its callback sets `exit_code`: 0 done, 1 a job failed, 2 an option is
// wrong, StoppedExitCode if the user stopped it.
#pragma once

#include <string>

#include "command_line/command.h"

namespace voxelpipe::cli {

// For options where an empty text (an unset shell variable) would silently mean something else.
inline std::string RefuseEmpty(const std::string& text) {
  return text.empty() ? "must not be empty" : "";
}

void AddAggregateCommand(Command& app, int& exit_code);
void AddBatchCommand(Command& app, int& exit_code);
void AddBenchCommand(Command& app, int& exit_code);
void AddCompareCommand(Command& app, int& exit_code);
// These read `app` when they run: all commands are there then.
void AddCompletionCommand(Command& app, int& exit_code);
void AddManualCommand(Command& app, int& exit_code);
void AddVoxelizeCommand(Command& app, int& exit_code);
void AddInfoCommand(Command& app, int& exit_code);
void AddShadersCommand(Command& app, int& exit_code);
void AddServerInfoCommand(Command& app, int& exit_code);

}  // namespace voxelpipe::cli
