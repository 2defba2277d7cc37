// Initial capacities of lists whose length is not known yet. The stages allocate by these rules and footprint.cpp
// predicts memory by them. No host-only includes, no CUDA headers.
#pragma once

#include <cstdint>

#include "base/vec.h"

namespace voxelpipe::cuda {

// Fragments of a slab: above the expected number, so that they rarely have to be listed again.
VOXELPIPE_HD uint64_t FragmentRoom(double expected) {
  constexpr double kMore = 1.25;
  constexpr uint64_t kAnyway = 1 << 16;
  return uint64_t(Min(kMore * expected, 0x1p62)) + kAnyway;
}

// Spans: few triangles of a fine mesh have any; each triangle of a coarse mesh has many.
VOXELPIPE_HD uint64_t SpanRoom(uint64_t triangles) {
  constexpr uint64_t kAnyway = 1 << 18, kOfFewTriangles = 64, kLeast = 1 << 10;
  return Min(triangles / 2 + kAnyway, kOfFewTriangles * triangles + kLeast);
}

// Slots of the brick pool (brick_scatter.cuh) of a slab of nx * ny * `layers` voxels: 2.5 times the bricks touched by a
// sphere that fills the slab's box.
inline constexpr uint32_t kBrickCells = 512;  // x + 8*(y + 8*z)
inline constexpr uint64_t kMaskWordsOfBrick = kBrickCells / 32;
VOXELPIPE_HD uint64_t BrickPoolRoom(int64_t nx, int64_t ny, int64_t layers) {
  constexpr uint64_t kOfFaces = 4, kLeast = 1 << 10;
  const uint64_t x = uint64_t(nx + 7) / 8, y = uint64_t(ny + 7) / 8, z = uint64_t(layers + 7) / 8;
  return Min(x * y * z, kLeast + kOfFaces * (x * y + y * z + z * x));
}

// Crossings of the slab's lines with parts, each with two keys of 8 bytes.
VOXELPIPE_HD uint64_t CrossingRoom(double expected) {
  constexpr double kMore = 1.25;
  constexpr uint64_t kAnyway = 1 << 12;
  return uint64_t(Min(kMore * expected, 0x1p58)) + kAnyway;
}

// Maximum bytes of the counters of a nonzero fill. Larger slabs are processed in batches of rows, at least one row
// each.
inline constexpr uint64_t kMaxSumBytes = 256 << 20;

}  // namespace voxelpipe::cuda
