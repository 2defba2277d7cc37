// Files of results for Python, by the writers of the command line.
#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <vector>

namespace voxelpipe {

// The output formats of this build, in the registry's order: a dict each, with the keys of _core.pyi.
pybind11::list Formats();

// In: a VoxelizeRequest and a ResultHeader as bytes, and the path of a file of that result. Out: what of the result the
// file will not tell, as one line; empty if nothing is lost. Raises Failed for a format that cannot hold the result,
// and for a strict request if something is lost.
std::string NotKept(const std::string& request, const std::string& header, const std::string& path);

// Writes a result to a file, which appears under its name when it is complete; after an error there is none. In: the
// same, and the arrays in stream order as flat buffers, which must not change meanwhile. The GIL is released. Raises
// Failed; OSError; what a signal handler raises.
void WriteFile(const std::string& request, const std::string& header, const std::vector<pybind11::buffer>& arrays,
               const std::string& path);

}  // namespace voxelpipe
