// Sizes of tasks and of the chunks by which lists grow: the memory of a run follows from them (footprint.cpp).
#pragma once

#include <cstdint>

namespace voxelpipe::cpu {

inline constexpr int64_t kTriangleGrain = 1 << 12;   // triangles of a task
inline constexpr uint64_t kBinChunkBytes = 2 << 20;  // a thread's lists of triangles or crossings grow by chunks
inline constexpr int64_t kMaxSlabLayers = 16;        // layers that share a list of triangles
inline constexpr int64_t kMaxLineBlocks = 1 << 11;   // of a fill: blocks of rows
inline constexpr int64_t kSumsOfBit = 32;            // bytes of a nonzero fill's counters, for a byte of bits
inline constexpr int64_t kSumBlockBytes = 32 << 10;  // of bits, in a block of rows of a nonzero fill

}  // namespace voxelpipe::cpu
