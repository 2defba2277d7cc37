// Messages about the options of a program that name what was typed and the next step. Both programs use them.
#pragma once

#include <string>

#include "command_line/command.h"

namespace voxelpipe {

// In: the program whose parsing stopped, and why. Out: the reason on one line, with the option or command that was
// probably meant, and the help to read.
std::string UsageError(const Program& program, const ParseStop& stop);

}  // namespace voxelpipe
