// Crossings of triangles with the lines along x through the voxel centres, binned to blocks of rows: the parity fill
// toggles at them, the nonzero fill sums their signs.
#pragma once

#include <cmath>
#include <cstdint>

#include "raster/crossing.h"

namespace voxelpipe::cpu {

// Layers [z_begin, z_end) of a grid. Their rows, r = y + ny*(z - z_begin), lie in blocks of 1 << block_shift each,
// which fewer than 2^32 bits hold: bit (r % rows of a block) * row_bits + x.
struct LineBlocks {
  int64_t nx, ny, z_begin, z_end;
  int64_t row_bits;  // nx, up to a whole word
  int block_shift;
  bool with_signs;  // of a nonzero fill

  // Number of kinds of crossings of a block: with voxels to toggle or without (`outside`), and with signs both again
  // for falling ones.
  int kinds() const { return with_signs ? 4 : 2; }
  int64_t rows() const { return ny * (z_end - z_begin); }
  int64_t blocks() const { return ((rows() - 1) >> block_shift) + 1; }
};

// A crossing: (block * kinds + falls * 2 + outside) << 32 | bit. `bit` is the last voxel that it toggles; with
// `outside` it toggles none, and `bit` is the index of the row in its block. `falls`: CrossingFalls, 0 without signs.
struct Crossings {
  static constexpr int64_t kMaxTriangles = 256;  // triangles at once
  static constexpr int kSmallRows = 8;           // and layers: triangles of more lines go to CrossLarge
  static constexpr int64_t kPadding = 8;
  int64_t count, larges;
  uint64_t crossing[kMaxTriangles * kSmallRows * kSmallRows + kPadding];
  uint32_t large[kMaxTriangles];

  void Clear() { count = larges = 0; }
  void Add(const LineBlocks& lines, int64_t y, int64_t z, int64_t before, bool falls) {
    const int64_t row = y + lines.ny * (z - lines.z_begin), block = row >> lines.block_shift;
    const auto in_block = uint64_t(row - (block << lines.block_shift));
    const uint64_t bit = before > 0 ? in_block * uint64_t(lines.row_bits) + uint64_t(before - 1) : in_block;
    const uint64_t kind = uint64_t(before > 0 ? 0 : 1) + uint64_t(falls && lines.with_signs ? 2 : 0);
    crossing[count++] = (uint64_t(block) * uint64_t(lines.kinds()) + kind) << 32 | bit;
  }
};

// The toggles of one block, or its sums for a nonzero fill.
struct BlockToggles {
  uint32_t* words;    // bit grid of the block's rows; nonzero fill: the bits that have a sum
  uint32_t* outside;  // one bit a row: an odd number of its crossings toggled no voxel; may be null
  // For a nonzero fill, modulo 2^32: +1 for a rising crossing, -1 for a falling one. Indexed by the last voxel before
  // the crossing; crossings before all voxels are indexed by row.
  uint32_t *sums = nullptr, *outside_sums = nullptr;

  void Sum(uint64_t bit, uint32_t sign) const {
    words[bit / 32] |= 1u << (bit % 32);
    sums[bit] += sign;
  }
};
inline constexpr uint32_t kRises = 1, kFalls = ~0u;

// Lines outside a triangle's y and z ranges by more than this, in voxels, do not cross it under any rounding of
// vertices within 2^40 voxels.
inline constexpr double kLineSlack = 0x1p-6;

// The lines that may cross a triangle.
struct LineRange {
  int64_t y_begin, y_end, z_begin, z_end;
  bool empty() const { return y_begin >= y_end || z_begin >= z_end; }
};
inline LineRange LinesOf(const Vec3d& a, const Vec3d& b, const Vec3d& c, const LineBlocks& lines) {
  const auto clamped = [](double v, int64_t lo, int64_t hi) { return int64_t(Clamp(v, double(lo), double(hi))); };
  const double y_lo = Min(a.y, Min(b.y, c.y)), y_hi = Max(a.y, Max(b.y, c.y));
  const double z_lo = Min(a.z, Min(b.z, c.z)), z_hi = Max(a.z, Max(b.z, c.z));
  // In y, exactly: an edge is crossed if y_lo <= y + .5 < y_hi.
  return {clamped(ceil(y_lo - 0.5), 0, lines.ny), clamped(ceil(y_hi - 0.5), 0, lines.ny),
          clamped(ceil(z_lo - (0.5 + kLineSlack)), lines.z_begin, lines.z_end),
          clamped(floor(z_hi - (0.5 - kLineSlack)) + 1, lines.z_begin, lines.z_end)};
}

// Calls visit(y, z, before, falls) for each line of `range` that crosses the triangle; `before` is the result of
// CentresBefore, `falls` that of CrossingFalls.
template <typename Visit>
void ForEachCrossing(const Vec3d& a, const Vec3d& b, const Vec3d& c, const LineRange& range, int64_t nx,
                     const Visit& visit) {
  if (range.empty()) return;
  const TrianglePlane plane = SetUpPlane(a, b, c);
  for (int64_t z = range.z_begin; z < range.z_end; ++z) {
    for (int64_t y = range.y_begin; y < range.y_end; ++y) {
      const double py = double(y) + 0.5, pz = double(z) + 0.5;
      if (!LineCrosses(a, b, c, py, pz)) continue;
      visit(y, z, CentresBefore(CrossingX(plane, a, b, c, py, pz), nx), CrossingFalls(a, b, c, py, pz));
    }
  }
}

// Toggles at a crossing of row `row` of the block, or adds it to the sums.
inline void ToggleRow(const LineBlocks& lines, const BlockToggles& out, int64_t row, int64_t before, bool falls) {
  if (out.sums != nullptr) {
    const uint32_t sign = falls ? kFalls : kRises;
    if (before == 0) {
      out.outside_sums[row] += sign;
    } else {
      out.Sum(uint64_t(row * lines.row_bits + before - 1), sign);
    }
  } else if (before == 0) {
    out.outside[row / 32] ^= 1u << (row % 32);
  } else {
    out.words[(row * lines.row_bits + before - 1) / 32] ^= 1u << ((before - 1) % 32);
  }
}

// Calls layer(z, y_begin, y_end, row) for each layer of `range` in a block; `row` is the row (y = 0, z), counted from
// the first of the block.
template <typename Layer>
void ForEachLayerOfBlock(const LineBlocks& lines, int64_t block, const LineRange& range, const Layer& layer) {
  const int64_t first = block << lines.block_shift;
  const int64_t end = Min(lines.rows(), (block + 1) << lines.block_shift);
  const int64_t z_begin = Max(range.z_begin, lines.z_begin + first / lines.ny);
  const int64_t z_end = Min(range.z_end, lines.z_begin + (end - 1) / lines.ny + 1);
  for (int64_t z = z_begin; z < z_end; ++z) {
    const int64_t row = lines.ny * (z - lines.z_begin);
    const int64_t y_begin = Max(range.y_begin, first - row), y_end = Min(range.y_end, end - row);
    if (y_begin < y_end) layer(z, y_begin, y_end, row - first);
  }
}

// As RowKernels::cross_large, in plain C++.
inline void CrossLargePlain(const Vec3d& a, const Vec3d& b, const Vec3d& c, const LineBlocks& lines, int64_t block,
                            const BlockToggles& out) {
  ForEachLayerOfBlock(
      lines, block, LinesOf(a, b, c, lines), [&](int64_t z, int64_t y_begin, int64_t y_end, int64_t row) {
        ForEachCrossing(
            a, b, c, {y_begin, y_end, z, z + 1}, lines.nx,
            [&](int64_t y, int64_t, int64_t before, bool falls) { ToggleRow(lines, out, row + y, before, falls); });
      });
}

}  // namespace voxelpipe::cpu
