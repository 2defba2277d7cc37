// The inner loops of the row-span rasterizer, one set for each instruction set. All sets give the same bits.
#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/statusor.h"
#include "pipeline/request.h"
#include "raster/spans.h"

namespace voxelpipe::cpu {

// The voxels along one axis that a vertex alone touches under the narrow widening, as 2*first + (last - first), saturated to 16 bits.
// The least and the largest code of three vertices give their triangle's box: first = least >> 1, last = (largest + 1) >> 1.
struct VertexCode {
  int16_t axis[4];  // x, y, z, 0
};
// Grids up to this many voxels an axis fit the codes.
inline constexpr int64_t kMaxCodedDim = 16000;

// Which kernel a triangle goes to.
inline constexpr int kSmallRows = 16;
enum class RowClass : uint8_t {
  kOutside,  // of the grid
  kRun,      // SpanClass::kRun: its box is its coverage
  kSmall,    // at most kSmallRows rows and layers: many triangles a vector
  kLarge,    // many rows of one triangle a vector
};

// The box in voxels, inclusive, and the class.
struct TriangleBox {
  int16_t first[3];
  int16_t row_class;  // RowClass
  int16_t last[3];
  int16_t unused;
};

// Layers of a bit grid that one thread writes.
struct RowSlab {
  uint32_t* words;  // row (y, z) begins at words + (y + ny*(z - begin)) * words_per_row
  int64_t words_per_row;
  int64_t nx, ny;
  int64_t begin, end;  // layers
};

// Vertices in index space, and the triangles over them.
struct RowMesh {
  const Vec3d* positions;
  const uint32_t (*triangles)[3];
};

struct RowKernels {
  std::string_view name;  // "scalar", "avx2", "avx512"
  // The box of vertices [begin, end), at least one. False if one is not finite; the box is then of no use.
  bool (*bounds)(const Vec3d* world, int64_t begin, int64_t end, Vec3d& least, Vec3d& most);
  // WorldToIndex of vertices [begin, end), and their codes. False if one is beyond 2^40 voxels or not finite.
  bool (*place)(const Vec3d* world, int64_t begin, int64_t end, const Vec3d& origin, const Vec3d& voxel_size,
                Vec3d* index, VertexCode* codes);
  // Boxes and classes of triangles [begin, end), into boxes[0...].
  void (*classify)(const uint32_t (*triangles)[3], const VertexCode* codes, int64_t begin, int64_t end,
                   const int64_t (&dims)[3], Coverage coverage, TriangleBox* boxes);
  // Sets the bits of triangles in the slab's layers. Any triangle may be given to either; each is fast for its class.
  void (*raster_small)(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab);
  void (*raster_large)(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab);
};

// FAILED_PRECONDITION where this machine lacks the instruction set. kAuto is the best that it has.
absl::StatusOr<const RowKernels*> SelectRowKernels(SimdChoice choice);

// Sets voxels x_begin <= x < x_end of a row.
inline void SetBits(uint32_t* row, int64_t x_begin, int64_t x_end) {
  const int64_t first = x_begin / 32, last = (x_end - 1) / 32;
  const uint32_t head = ~0u << (x_begin % 32), tail = ~0u >> (31 - (x_end - 1) % 32);
  if (first == last) {
    row[first] |= head & tail;
    return;
  }
  row[first] |= head;
  for (int64_t w = first + 1; w < last; ++w) row[w] = ~0u;
  row[last] |= tail;
}

}  // namespace voxelpipe::cpu
