// The rows that triangles cover in one tile, several triangles at once.
#pragma once

#include <cstdint>

#include "raster/spans.h"
#include "raster/tiles.h"

namespace voxelpipe::cpu {

// The tiles that a triangle's box touches, inclusive, cut to the grid.
struct TileBox {
  // kBoxed: the box is at most kMaxExtent + 1 voxels along each axis, so that its widening is that of the narrow class
  // for every class of triangle.
  enum Kind : int16_t { kOutside, kBoxed, kLarge };
  static constexpr int16_t kMaxExtent = 63;

  int16_t first[3];
  int16_t kind;
  int16_t last[3];
  int16_t unused;

  int64_t tiles() const {
    return int64_t{last[0] - first[0] + 1} * (last[1] - first[1] + 1) * (last[2] - first[2] + 1);
  }
};

// A run of voxels in a row of a tile: the row y + 8*z in bits 0-5, its first voxel in bits 8-12, its last in bits
// 16-20.
struct TileSpan {
  uint32_t bits;

  static TileSpan At(int64_t row, int64_t first, int64_t last) {
    return {uint32_t(row) | uint32_t(first) << 8 | uint32_t(last) << 16};
  }
  int row() const { return int(bits & 63); }
  int first() const { return int(bits >> 8 & 31); }
  int last() const { return int(bits >> 16); }
  uint32_t mask() const { return (~0u >> (31 - last())) & (~0u << first()); }
};

// Spans of up to kTriangles triangles, each triangle's in the order of its rows.
struct TileSpans {
  static constexpr int kTriangles = 16;

  int32_t count[kTriangles];
  TileSpan spans[kTriangles][kTileRows];

  void Add(int triangle, int64_t row, int64_t first, int64_t last) {
    spans[triangle][count[triangle]++] = TileSpan::At(row, first, last);
  }
};

// In: a set-up triangle, the voxels of a tile (clipped to the grid). Out: appends its spans in the tile, as spans of
// `triangle`. Not inline: device compilers also read this header and reject its visitor.
void AddTileSpans(const TriangleSetup& setup, const VoxelRange& tile, int triangle, TileSpans& out);

}  // namespace voxelpipe::cpu
