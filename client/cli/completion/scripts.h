// Scripts that complete the command line in a shell, and the manual page: all made of the program's own options.
#pragma once

#include <string>

#include "completion/command_model.h"

namespace voxelpipe::cli {

// For `source <(voxelpipe completion bash)` and for bash-completion's directory. Needs bash 4, nothing else.
std::string BashCompletion(const ProgramModel& program);
// For `source <(voxelpipe completion zsh)` after compinit, and as the file _voxelpipe on fpath.
std::string ZshCompletion(const ProgramModel& program);
// For `voxelpipe completion fish | source`, and for vendor_completions.d.
std::string FishCompletion(const ProgramModel& program);

// The page in man(7)'s macros. In: the version of the program.
std::string ManualPage(const ProgramModel& program, const std::string& version);

}  // namespace voxelpipe::cli
