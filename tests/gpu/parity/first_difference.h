// The first difference of two results.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "job/result.h"

namespace voxelpipe::gpu {

// A result as bytes, however it was delivered.
struct Delivered {
  ResultHeader header;
  std::vector<std::vector<uint8_t>> arrays;  // of header.arrays
  VoxelizeStats stats;
};

// Empty if grid, arrays and counts (occupied, odd_columns, and fragments if both count them) are equal; otherwise a
// line that names the first array, the element and both values, and how many elements of it differ.
std::optional<std::string> FirstDifference(const Delivered& expected, const Delivered& got);

}  // namespace voxelpipe::gpu
