// Formats, blends and layouts of render targets.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"

namespace voxelpipe {

enum class VoxelFormat : uint8_t {
  kBit,  // bit n of the linear order is (byte[n/8] >> (n%8)) & 1, no row padding, unused bits 0
  kF32,  // IEEE binary32, little endian
};

// All blends are independent of the order in which triangles arrive.
enum class Blend : uint8_t {
  kOr,       // bit: 1 if any fragment's value is not 0
  kReplace,  // the fragment of the largest triangle id wins
  kMin,      // component-wise, -0 < +0
  kMax,      // component-wise, -0 < +0
  kAdd,  // f32: each value clamped to +-2^40 q, rounded to a multiple of the quantum q, summed in int64, converted once
};

enum class Layout : uint8_t {
  kInterleaved,  // value c of voxel n at n*components + c; numpy (nz, ny, nx[, c])
  kPlanar,       // value c of voxel n at c*voxels + n; numpy ([c,] nz, ny, nx)
};

std::string_view Name(VoxelFormat format);
std::string_view Name(Blend blend);
std::optional<VoxelFormat> ParseVoxelFormat(std::string_view name);
std::optional<Blend> ParseBlend(std::string_view name);

// Size of one component in bits: 1 for kBit.
int BitsPerComponent(VoxelFormat format);

// INVALID_ARGUMENT if `blend` is not defined for `format` (bit: or, replace; f32: replace, min, max, add).
absl::Status CheckBlend(VoxelFormat format, Blend blend);

}  // namespace voxelpipe
