// Names and rules of formats, encodings, blends and layouts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "grid/formats.h"

namespace voxelpipe {

enum class Layout : uint8_t {
  kInterleaved,  // value c of voxel n at n*components + c; numpy (nz, ny, nx[, c])
  kPlanar,       // value c of voxel n at c*voxels + n; numpy ([c,] nz, ny, nx)
};

std::string_view Name(VoxelFormat format);
std::string_view Name(Blend blend);
std::string_view Name(Encoding encoding);
std::optional<VoxelFormat> ParseVoxelFormat(std::string_view name);
std::optional<Blend> ParseBlend(std::string_view name);
std::optional<Encoding> ParseEncoding(std::string_view name);

// Size of one component in bits: 1 for kBit, else 8, 16 or 32.
int BitsPerComponent(VoxelFormat format);

// INVALID_ARGUMENT if `blend` is not defined for `format`: bit takes or, and, replace, first, count; integers all;
// floats all but and, or.
absl::Status CheckBlend(VoxelFormat format, Blend blend);

}  // namespace voxelpipe
