// Messages about the options of a program that name what was typed and the next step. Both programs use them.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace voxelpipe {

// In: the app whose parsing failed, and why. Out: the reason on one line, with the option or command that was probably
// meant, and the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& error);

}  // namespace voxelpipe
