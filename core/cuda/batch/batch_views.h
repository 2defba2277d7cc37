// What kernels get of a batch: plain structs, no host-only includes.
//
// All grids of a batch lie in one index space of words and rows, one behind the other, those of A-buffers in one of
// voxels; so do vertices, triangles and the words of the results. What belongs to whom is found by bisection among the
// items, whose firsts ascend.
#pragma once

#include "cuda/primitives/blend_rules.h"
#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"
#include "shaders/fill_value.h"

namespace voxelpipe::cuda {

// How an item's fragments are shaded.
struct BatchShading {
  const MeshView* mesh = nullptr;
  uint32_t first_target = 0;  // of BatchView::shaded, or of BatchValues
  int target_count = 0;
  ShaderTraits traits;  // of all targets' shaders together
  bool planar = false;
  bool shades = false;  // some target is blended from what its shader gives
  bool drops = false;   // every target's shader can discard: a fragment that all do is none
};

// One grid of the batch, a single slab.
struct BatchItemView {
  GridView grid;
  Coverage coverage{};
  bool parity = false, flood = false;  // fill
  bool own_shell = false;              // of a flood: its coverage is not the conservative shell
  bool look_first = false;             // far more triangles than voxels of its faces
  // Its mesh, which may lie anywhere on the device.
  const Vec3d* positions = nullptr;  // world space
  const uint32_t* triangles = nullptr;
  // Where its part begins among all vertices, triangles, rows of bit grids, their words, words of columns, words of
  // shells, and voxels of items with fragments. Items of plain bits, which have none, come first; A-buffers, which have
  // no bit grid, last.
  uint64_t first_vertex = 0, first_triangle = 0, first_row = 0, first_word = 0, first_column = 0;
  uint64_t first_shell = 0, first_voxel = 0;
  // Where the bits of the voxels that its triangles touch begin among the words of bit grids: its coverage, or a grid
  // beside it if every target's shader can discard. A multiple of 4, as first_word.
  uint64_t first_touched = 0;
  uint64_t triangle_count = 0;
  uint64_t words = 0;        // of its bit grid
  int64_t column_words = 0;  // of a layer's columns (parity_fill.cu)
  BatchShading shading;

  VOXELPIPE_HD bool filled() const { return parity || flood; }
};

// One bit target: packed bits, made of an item's coverage and inside.
struct BatchTargetView {
  uint32_t item = 0;
  const uint32_t *present = nullptr, *value = nullptr;  // bit grids; null: the coverage
  uint32_t clear = 0, fill = 0;                         // all bits set or none
  uint64_t first_packed = 0;                            // its first word among the packed ones
  uint64_t voxels = 0;
};

// One target of other formats: elements over an item's grid, as its result has them.
struct BatchValueView {
  uint32_t item = 0;
  int components = 1, element_bytes = 4;
  bool planar = false;
  uint32_t clear_stored = 0;
  FillValue fill;
  const uint32_t* present = nullptr;  // bit grid; null: the coverage
  uint8_t* at = nullptr;
  uint64_t words = 0;  // of 32 bits, up to a whole unit of 16 bytes
  uint64_t voxels = 0;
};

struct BatchCounts {
  uint64_t occupied = 0, odd_columns = 0, fragments = 0;
  uint64_t unfinished = 0;  // not 0: the flood takes more sweeps than a pass waits for, and the item has no result
};

// Elements of BatchView::queued, the first ones of a stage.
enum BatchQueue : int {
  kBatchRows = 0,       // as in WalkArgs
  kBatchFill = 4,       // of the parity fill
  kBatchFragments = 5,  // as in WalkArgs
  kBatchShells = 9,     // likewise
  kBatchValues = 13,    // likewise
  kBatchQueues = 17
};

struct BatchView {
  const BatchItemView* items = nullptr;
  const BatchTargetView* targets = nullptr;
  const BatchValueView* values = nullptr;
  uint32_t item_count = 0, target_count = 0, value_count = 0;
  // Triangles of items of plain bits, and behind them those of items whose targets have values.
  uint64_t row_triangles = 0, value_triangles = 0;
  // Of the triangles, those of items with a shell of their own; and the items that are flooded.
  uint64_t first_shell_triangle = 0, shell_triangles = 0;
  uint32_t first_flood = 0, flood_count = 0;
  uint64_t voxel_count = 0;             // of items with fragments
  const CudaTarget* shaded = nullptr;   // targets of A-buffers
  uint32_t* value_counts = nullptr;     // fragments per triangle of an item with values, and one more, which stays 0
  uint32_t* fragment_counts = nullptr;  // likewise of an A-buffer
  uint64_t vertex_count = 0, triangle_count = 0, row_count = 0, packed_words = 0;
  bool any_parity = false;
  VOXELPIPE_HD bool any_fill() const { return any_parity || flood_count > 0; }
  Vec3d* placed = nullptr;  // vertices in index space
  VertexCode* codes = nullptr;
  uint32_t* triangles = nullptr;  // of vertices among all
  uint32_t* item_of = nullptr;    // per triangle
  uint32_t* queue[3] = {};        // room for all triangles in each
  // Cleared at the beginning, together.
  void* zero = nullptr;
  uint64_t zero_quads = 0;         // of 16 bytes
  uint64_t* queued = nullptr;      // see BatchQueue
  uint32_t* bits = nullptr;        // coverage, and what first_touched stands for
  uint32_t* word_ranks = nullptr;  // per word of `bits` (Ranks)
  uint32_t* shells = nullptr;      // of items with one of their own
  uint32_t* inside = nullptr;      // where any item has a fill
  uint32_t* columns = nullptr;     // of items with parity fill: parity of each column's crossings
  BatchCounts* counts = nullptr;   // per item
  uint32_t* packed = nullptr;
};

// Sorted fragments of one A-buffer that are shaded.
struct BatchFragmentRange {
  uint32_t item = 0;
  uint64_t first = 0, count = 0;
  uint64_t first_thread = 0;  // a multiple of 32: no warp has two ranges
};

struct BatchShadeArgs {
  const BatchFragmentRange* ranges = nullptr;
  uint32_t range_count = 0;
  uint64_t threads = 0;                                  // of all ranges
  uint8_t* const* out = nullptr;                         // per target of BatchView::shaded
  const uint32_t *keys = nullptr, *triangles = nullptr;  // sorted
};

}  // namespace voxelpipe::cuda
