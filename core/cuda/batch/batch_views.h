// Kernel views of a batch: plain structs, no host-only includes.
//
// The grids of a batch are concatenated in one index space of words and rows, those of A-buffers in one of voxels, and
// so are vertices, triangles and result words. The item of an element is found by binary search over the items, whose
// offsets ascend.
#pragma once

#include "cuda/primitives/blend_rules.h"
#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"
#include "shaders/fill_value.h"

namespace voxelpipe::cuda {

// How an item's fragments are shaded.
struct BatchShading {
  const MeshView* mesh = nullptr;
  uint32_t first_target = 0;  // in BatchView::shaded, or in BatchValues
  int target_count = 0;
  ShaderTraits traits;  // union over all targets' shaders
  bool planar = false;
  bool shades = false;  // some target's blend needs the shader's value
  bool drops = false;   // every target's shader can discard: fragments that all of them discard are dropped
};

// One grid of the batch, as a single slab.
struct BatchItemView {
  GridView grid;
  Coverage coverage{};
  bool parity = false, flood = false;  // fill
  bool own_shell = false;              // flood fill whose shell differs from the coverage
  bool look_first = false;             // read before the atomic: far more triangles than voxels on the grid's faces
  // Its mesh, anywhere on the device.
  const Vec3d* positions = nullptr;  // world space
  const uint32_t* triangles = nullptr;
  // Offsets of the item within all vertices, triangles, rows of bit grids, their words, words of columns, words of
  // shells, and voxels of items with fragments. Items of occupancy bits, which have no fragments, come first;
  // A-buffers, which have no bit grid, last.
  uint64_t first_vertex = 0, first_triangle = 0, first_row = 0, first_word = 0, first_column = 0;
  uint64_t first_shell = 0, first_voxel = 0;
  // Word offset of the bits of touched voxels: the coverage, or a separate grid if every target's shader can discard.
  // A multiple of 4, like first_word.
  uint64_t first_touched = 0;
  uint64_t triangle_count = 0;
  uint64_t words = 0;        // of its bit grid
  int64_t column_words = 0;  // of the columns of a layer (parity_fill.cu)
  BatchShading shading;

  VOXELPIPE_HD bool filled() const { return parity || flood; }
};

// A bit target: packed bits, made from an item's coverage and inside grids.
struct BatchTargetView {
  uint32_t item = 0;
  const uint32_t *present = nullptr, *value = nullptr;  // bit grids; null: the coverage
  uint32_t clear = 0, fill = 0;                         // all bits set or none
  uint64_t first_packed = 0;                            // offset in the packed words
  uint64_t voxels = 0;
};

// A target of another format: elements over an item's grid, in the result's layout.
struct BatchValueView {
  uint32_t item = 0;
  int components = 1, element_bytes = 4;
  bool planar = false;
  uint32_t clear_stored = 0;
  FillValue fill;
  const uint32_t* present = nullptr;  // bit grid; null: the coverage
  uint8_t* at = nullptr;
  uint64_t words = 0;  // 32-bit words, rounded up to 16 bytes
  uint64_t voxels = 0;
};

struct BatchCounts {
  uint64_t occupied = 0, odd_columns = 0, fragments = 0;
  // Not 0: the flood fill needs more sweeps than a pass allows, and the item has no result.
  uint64_t unfinished = 0;
};

// Indices of the first queue counter of each stage in BatchView::queued.
enum BatchQueue : int {
  kBatchRows = 0,       // as in WalkArgs
  kBatchFill = 4,       // as in CrossingArgs, of the parity fill
  kBatchFragments = 6,  // as in WalkArgs
  kBatchShells = 10,    // as in WalkArgs
  kBatchValues = 14,    // as in WalkArgs
  kBatchQueues = 18
};

struct BatchView {
  const BatchItemView* items = nullptr;
  const BatchTargetView* targets = nullptr;
  const BatchValueView* values = nullptr;
  uint32_t item_count = 0, target_count = 0, value_count = 0;
  // Triangles of items with occupancy bits, followed by those of items with values.
  uint64_t row_triangles = 0, value_triangles = 0;
  // Triangles of items with their own shell, and items with flood fill.
  uint64_t first_shell_triangle = 0, shell_triangles = 0;
  uint32_t first_flood = 0, flood_count = 0;
  uint64_t voxel_count = 0;             // of items with fragments
  const CudaTarget* shaded = nullptr;   // targets of A-buffers
  uint32_t* value_counts = nullptr;     // fragments per triangle of items with values, followed by a 0
  uint32_t* fragment_counts = nullptr;  // the same for A-buffers
  uint64_t vertex_count = 0, triangle_count = 0, row_count = 0, packed_words = 0;
  bool any_parity = false;
  VOXELPIPE_HD bool any_fill() const { return any_parity || flood_count > 0; }
  Vec3d* placed = nullptr;  // vertices in index space
  VertexCode* codes = nullptr;
  uint32_t* triangles = nullptr;  // vertex indices in the batch
  uint32_t* item_of = nullptr;    // per triangle
  uint32_t* queue[3] = {};        // capacity of all triangles each
  // Memory that is cleared together at the start.
  void* zero = nullptr;
  uint64_t zero_quads = 0;         // 16-byte units
  uint64_t* queued = nullptr;      // indexed by BatchQueue
  uint32_t* bits = nullptr;        // coverage, and the touched voxels of first_touched
  uint32_t* word_ranks = nullptr;  // per word of `bits` (Ranks)
  uint32_t* shells = nullptr;      // of items with their own shell
  uint32_t* inside = nullptr;      // if some item has a fill
  uint32_t* columns = nullptr;     // of items with parity fill: parity of each column's crossings
  BatchCounts* counts = nullptr;   // per item
  uint32_t* packed = nullptr;
};

// The sorted fragments of one A-buffer that is shaded.
struct BatchFragmentRange {
  uint32_t item = 0;
  uint64_t first = 0, count = 0;
  uint64_t first_thread = 0;  // a multiple of 32: a warp has a single range
};

struct BatchShadeArgs {
  const BatchFragmentRange* ranges = nullptr;
  uint32_t range_count = 0;
  uint64_t threads = 0;                                  // of all ranges
  uint8_t* const* out = nullptr;                         // per target of BatchView::shaded
  const uint32_t *keys = nullptr, *triangles = nullptr;  // sorted
};

}  // namespace voxelpipe::cuda
