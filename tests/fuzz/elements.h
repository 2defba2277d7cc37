// Single values of a result's target, as the bits that are stored.
#pragma once

#include <cstdint>
#include <cstring>

#include "job/result.h"

namespace voxelpipe::fuzz {

// Component `c` of value `n` among `count` of target `t`.
inline uint32_t ElementAt(const VoxelizeResult& result, size_t t, int c, uint64_t n, uint64_t count) {
  const TargetSpec& spec = result.specs[t];
  const uint64_t i =
      result.layout == Layout::kPlanar ? uint64_t(c) * count + n : n * uint64_t(spec.components) + uint64_t(c);
  const uint8_t* bytes = result.targets[t].data();
  if (spec.format == VoxelFormat::kBit) return (bytes[i / 8] >> (i % 8)) & 1;
  const size_t size = size_t(BitsPerComponent(spec.format) / 8);
  uint32_t value = 0;
  std::memcpy(&value, bytes + i * size, size);
  return value;
}

inline uint64_t U64At(const HostBuffer& buffer, uint64_t i) {
  uint64_t value;
  std::memcpy(&value, buffer.data() + i * sizeof value, sizeof value);
  return value;
}

inline uint32_t U32At(const HostBuffer& buffer, uint64_t i) {
  uint32_t value;
  std::memcpy(&value, buffer.data() + i * sizeof value, sizeof value);
  return value;
}

}  // namespace voxelpipe::fuzz
