// The inner loops of the row-span rasterizer, one table of functions for each instruction set. All give the same bits.
#pragma once

#include <atomic>
#include <cstdint>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "cpu/rows/crossings.h"
#include "cpu/rows/tile_spans.h"
#include "grid/index_space.h"
#include "job/request.h"
#include "raster/row_bits_fit.h"

namespace voxelpipe::cpu {

// The voxels along one axis that a vertex alone touches under the narrow widening, as 2*first + (last - first),
// saturated to 16 bits. The smallest and the largest code of its three vertices give a triangle's box: first = smallest
// >> 1, last = (largest + 1) >> 1.
struct VertexCode {
  int16_t axis[4];  // x, y, z, 0
};
static_assert(2 * kMaxCodedDim < INT16_MAX);

// Layers of a bit grid, cleared by the caller.
struct RowSlab {
  uint32_t* words;  // null: scan only. Row (y, z) begins at words + (y + ny*(z - begin)) * words_per_row
  int64_t words_per_row;
  int64_t nx, ny;
  int64_t begin, end;  // layers
  bool shared;         // other threads may write the same words
};
// A slab has fewer words than this: 32-bit lanes address them.
inline constexpr int64_t kMaxSlabWords = int64_t{1} << 31;

// Vertices in world space, their codes, the grid, and the triangles over them.
struct RowMesh {
  const Vec3d* positions;
  const VertexCode* codes;
  const uint32_t (*triangles)[3];
  IndexSpace space;
  bool regular;  // Placed::regular of all vertices
};

// A mesh whose vertices are in index space already.
inline RowMesh IndexSpaceMesh(const Vec3d* positions, const uint32_t (*triangles)[3]) {
  return {positions, nullptr, triangles, IndexSpace{}, true};
}

// The triangles that a scan did not finish, by class.
//   small  at most kSmallRows rows and layers: several triangles per vector
//   large  several rows of one triangle per vector
//   runs   SpanClass::kRun: the coverage is the box
inline constexpr int kSmallRows = 16;
struct RowLists {
  static constexpr int64_t kMaxTriangles = 2048;  // triangles: the lists stay in the L1 cache
  static constexpr int64_t kPadding = 16;         // vectors are stored whole
  int64_t smalls, larges, runs;                   // counts
  uint32_t small[kMaxTriangles + kPadding], large[kMaxTriangles], run[kMaxTriangles];
  uint32_t shape[kMaxTriangles + kPadding];  // of the small ones: rows - 1 + kSmallRows * (layers - 1)
  uint32_t sorted[kMaxTriangles];

  void Clear() { smalls = larges = runs = 0; }
  void AddSmall(uint32_t id, uint32_t id_shape) {
    small[smalls] = id;
    shape[smalls++] = id_shape;
  }
  // Fills `sorted` with the small ones by shape, so that those of one vector have the same number of rows.
  void SortSmall();
};

// Properties of a range of vertices.
struct Placed {
  bool near;     // all are finite and within 2^40 voxels
  bool regular;  // all coordinates are at distances from the origin for which no step of the division can underflow
};

struct RowKernels {
  std::string_view name;  // "scalar", "avx2", "avx512"
  // The codes of vertices [begin, end), and WorldToIndex of them where `index` is not null.
  Placed (*place)(const Vec3d* world, int64_t begin, int64_t end, const IndexSpace& space, Vec3d* index,
                  VertexCode* codes);
  // Triangles [begin, end), at most RowLists::kMaxTriangles: drops those outside the slab. If the slab has words, sets
  // the bits of runs and drops triangles whose boxes are already set. Adds the others to `lists`.
  void (*scan)(const RowMesh& mesh, int64_t begin, int64_t end, Coverage coverage, const RowSlab& slab,
               RowLists& lists);
  // Sets the bits of triangles in the slab's layers. Each accepts every triangle and is fast for its class.
  void (*raster_small)(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab);
  void (*raster_large)(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab);
  // Writes the boxes of triangles [begin, end) to boxes[0...]. For grids that fit the codes.
  void (*tile_boxes)(const uint32_t (*triangles)[3], const VertexCode* codes, int64_t begin, int64_t end,
                     const int64_t (&dims)[3], TileBox* boxes);
  // The spans of triangles, the low 32 bits of pairs[0...count), in a tile (clipped to the grid); at most
  // TileSpans::kTriangles. The mesh is one of IndexSpaceMesh.
  void (*spans_in_tile)(const RowMesh& mesh, const uint64_t* pairs, int64_t count, Coverage coverage,
                        const VoxelRange& tile, TileSpans& out);
  // Parity and nonzero fill, over a mesh of IndexSpaceMesh. Triangles [begin, end), at most Crossings::kMaxTriangles:
  // appends the crossings of those with few lines, and the ids of the others.
  void (*cross_small)(const RowMesh& mesh, int64_t begin, int64_t end, const LineBlocks& lines, Crossings& out);
  // Toggles at, or sums, the crossings of any triangle with the lines of one block.
  void (*cross_large)(const RowMesh& mesh, uint32_t id, const LineBlocks& lines, int64_t block,
                      const BlockToggles& out);
  // Bit i of each row becomes the parity of the row's toggles at i and beyond; with `add` it is or-ed to the bits in
  // `out`. Rows are contiguous in both. Returns the number of rows with an odd number of crossings.
  int64_t (*spread_toggles)(const BlockToggles& in, int64_t rows, int64_t words_per_row, uint32_t* out, bool add);
};

// Tile coordinates of grids up to this many voxels an axis fit the lanes of RowKernels::spans_in_tile.
inline constexpr int64_t kMaxLaneDim = int64_t{1} << 30;

// FAILED_PRECONDITION if this machine lacks the instruction set. kAuto selects its best one.
absl::StatusOr<const RowKernels*> SelectRowKernels(SimdChoice choice);

// Sets bits of a word. Writes, atomically if `shared`, only if the word changes, which is rare on fine meshes.
inline void OrWord(uint32_t& word, uint32_t bits, bool shared) {
  if (!shared) {
    word |= bits;
    return;
  }
  const std::atomic_ref<uint32_t> atomic(word);
  if ((~atomic.load(std::memory_order_relaxed) & bits) != 0) atomic.fetch_or(bits, std::memory_order_relaxed);
}

// Sets voxels x_begin <= x < x_end of a row.
inline void SetBits(uint32_t* row, int64_t x_begin, int64_t x_end, bool shared) {
  const int64_t first = x_begin / 32, last = (x_end - 1) / 32;
  const uint32_t head = ~0u << (x_begin % 32), tail = ~0u >> (31 - (x_end - 1) % 32);
  if (first == last) return OrWord(row[first], head & tail, shared);
  OrWord(row[first], head, shared);
  if (shared) {
    for (int64_t w = first + 1; w < last; ++w) std::atomic_ref<uint32_t>(row[w]).store(~0u, std::memory_order_relaxed);
  } else {
    for (int64_t w = first + 1; w < last; ++w) row[w] = ~0u;
  }
  OrWord(row[last], tail, shared);
}

// Sets the part of a box of voxels, first to last inclusive, that lies in the slab.
inline void SetBox(const RowSlab& slab, const int64_t (&first)[3], const int64_t (&last)[3]) {
  const int64_t x0 = Max<int64_t>(0, first[0]), x1 = Min(slab.nx, last[0] + 1);
  const int64_t y0 = Max<int64_t>(0, first[1]), y1 = Min(slab.ny, last[1] + 1);
  const int64_t z0 = Max(slab.begin, first[2]), z1 = Min(slab.end, last[2] + 1);
  if (x0 >= x1) return;
  for (int64_t z = z0; z < z1; ++z) {
    for (int64_t y = y0; y < y1; ++y) {
      SetBits(slab.words + (y + slab.ny * (z - slab.begin)) * slab.words_per_row, x0, x1, slab.shared);
    }
  }
}

}  // namespace voxelpipe::cpu
