// The JSON description of the bytes of a .raw file.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "job/result.h"

namespace voxelpipe {

// The path of the description of `path`, a .raw output: PATH.json, with the name cut if it is too long for a file.
std::string RawDescriptionPath(const std::string& path);

// In: a dense result's header, the files of its targets in order, and the SHA-256 of all their bytes in that order (64
// hexadecimal digits; empty: not known). Out: one JSON object with dims [nx,ny,nz], origin, voxel_size, index_to_world
// (4x4, of voxel centres), layout, order, targets (file, format, components, encoding, blend, shader, dtype as NumPy
// names it or "bit", shape in C order, bytes) and hash; with `parts` that are not empty also parts (part_json.h).
std::string DescribeRaw(const ResultHeader& header, const std::vector<std::string>& files, std::string_view sha256,
                        const PartTable& parts = {});

}  // namespace voxelpipe
