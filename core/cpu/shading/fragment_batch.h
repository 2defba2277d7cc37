// Fragments as structures of arrays: what a shader reads, and what it makes, of many fragments at once.
#pragma once

#include <cstdint>

#include "mesh/views/mesh_view.h"
#include "raster/tiles.h"

namespace voxelpipe::cpu {

inline constexpr int kBatchFragments = 128;

// Fragments of triangles of one part of the mesh in one tile, those of a triangle side by side. Fragments are added,
// then Complete prepares the batch for the kernels, which read whole multiples of kPadding.
struct FragmentBatch {
  static constexpr int kPadding = 8;

  const MeshView* mesh = nullptr;
  const PartView* part = nullptr;
  int32_t origin[3] = {};  // the tile's first voxel

  // Of each triangle.
  int triangles = 0;
  alignas(64) uint32_t triangle[kBatchFragments];    // its number in the mesh
  alignas(64) int32_t vertex[3][kBatchFragments];    // its vertices' indices
  alignas(64) uint32_t degenerate[kBatchFragments];  // 0 or ~0; set by ShadeKernels::place

  // Of each fragment.
  int count = 0;
  alignas(64) int32_t triangle_of[kBatchFragments];   // index of its triangle in the batch
  alignas(64) uint16_t place[kBatchFragments];        // its voxel in the tile: x + 32*(y + 8*z)
  alignas(64) int32_t voxel[3][kBatchFragments];      // grid coordinates; set by Complete
  alignas(64) float barycentric[3][kBatchFragments];  // set by ShadeKernels::place, where a shader needs them

  void Clear() { triangles = count = 0; }
  bool full() const { return count == kBatchFragments; }

  // Fragments that are added then belong to this triangle.
  void AddTriangle(uint32_t number) {
    triangle[triangles] = number;
    for (int k = 0; k < 3; ++k) vertex[k][triangles] = int32_t(mesh->triangles[number][k]);
    ++triangles;
  }
  void AddFragment(size_t place_in_tile) {
    triangle_of[count] = triangles - 1;
    place[count] = uint16_t(place_in_tile);
    ++count;
  }
  // Not of an empty batch.
  void Complete() {
    for (int i = triangles; i % kPadding != 0; ++i) {
      for (auto& corner : vertex) corner[i] = corner[triangles - 1];
    }
    int padded = count;
    for (; padded % kPadding != 0; ++padded) {
      triangle_of[padded] = triangle_of[count - 1];
      place[padded] = place[count - 1];
    }
    static_assert(TileDim(0) == 32 && TileDim(1) == 8);
    for (int i = 0; i < padded; ++i) {
      voxel[0][i] = origin[0] + (place[i] & 31);
      voxel[1][i] = origin[1] + (place[i] >> 5 & 7);
      voxel[2][i] = origin[2] + (place[i] >> 8);
    }
  }
};

// What a shader makes of a batch: FragmentOutput of each fragment. A shader sets the values of its output's type, all
// four components, and `discard`.
struct ShadedBatch {
  alignas(64) float f[4][kBatchFragments] = {};
  alignas(64) uint32_t u[4][kBatchFragments] = {};
  alignas(64) uint32_t discard[kBatchFragments] = {};  // 0 or ~0
};

}  // namespace voxelpipe::cpu
