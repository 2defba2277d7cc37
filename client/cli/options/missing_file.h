// What a name of a mesh file that cannot be read was meant to be.
#pragma once

#include <string>

namespace voxelpipe::cli {

// What could be meant in place of a file that cannot be read, as " (did you mean 'bunny.glb'?)". Empty if the file
// exists, or nothing is near.
std::string MissingFileHint(const std::string& path);

}  // namespace voxelpipe::cli
