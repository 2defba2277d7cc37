// Messages about the command line that name the next step.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace voxelpipe::cli {

// In: the app whose parsing failed, and why. Out: the reason on one line, with the option or command that was probably
// meant, and the help to read.
std::string UsageError(const CLI::App& app, const CLI::ParseError& error);

// For a mesh file that cannot be read: what could be meant instead, as " (did you mean 'bunny.glb'?)". Empty if the
// file exists, or nothing is near.
std::string MissingFileHint(const std::string& path);

}  // namespace voxelpipe::cli
