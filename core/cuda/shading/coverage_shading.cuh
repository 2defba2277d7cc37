// Shades the fragments of coverage records (coverage_record.h) or spans (span.h) and blends them into accumulators. No
// host-only includes.
//
// A block loads one record per thread, computes the inputs shared by a triangle's fragments, and numbers all fragments
// by a scan. Then each thread shades one fragment at a time, of any triangle, so that all lanes of a warp are busy.
#pragma once

#include "cuda/coverage/accumulators.cuh"
#include "cuda/coverage/set_bits.cuh"
#include "cuda/primitives/coverage_record.h"
#include "cuda/primitives/fast_divide.h"
#include "cuda/primitives/span.h"
#include "cuda/primitives/warp_reduce.cuh"
#include "cuda/shading/blend_fragment.cuh"
#include "cuda/shading/fragment_shading.cuh"
#include "cuda/traversal/row_traversal.cuh"
#include "raster/filtered/fixed_point.h"

namespace voxelpipe::cuda {

inline constexpr int kShadeThreads = 128;

struct CoverageShadingArgs {
  // Records and the masks of blocks; or spans, if `spans` is set.
  const uint64_t *records = nullptr, *blocks = nullptr, *spans = nullptr;
  uint64_t count = 0;
  uint32_t first_triangle = 0;           // of spans: as in SpanArgs
  const PackedVertex* placed = nullptr;  // of records: triangles in their order; null: by id
  GridView grid;
  Divisor by_words_per_row, by_ny;
  const MeshView* mesh = nullptr;
  ShaderTraits traits;  // union over all targets' shaders
  Ranks ranks;
  uint32_t* coverage = nullptr;  // bit grid of voxels with a fragment that some target keeps; null: all are covered
  ShadedTarget targets[kMaxTargets];
  int target_count = 0;
};

// The voxels of a record or span, from bit index `first` on.
struct CoverageEntry {
  uint64_t mask;  // block: x + 4y + 16z; 2x2x2: x + 2y + 4z; span: the lowest `length` bits
  uint32_t first, triangle;
  CellKind kind;  // kOther: a span
};

__device__ inline CoverageEntry LoadEntry(const CoverageShadingArgs& args, uint64_t i) {
  CoverageEntry entry{};
  if (args.spans != nullptr) {
    const uint64_t span = args.spans[i];
    if (span == kNoSpan) return entry;
    entry.mask = ~0u >> (32 - SpanLength(span));
    entry.first = SpanFirst(span);
    entry.triangle = args.first_triangle + SpanTriangle(span);
    entry.kind = CellKind::kOther;
    return entry;
  }
  const uint64_t record = args.records[i];
  entry.kind = KindOfCell(record);
  if (entry.kind == CellKind::kOther) return entry;  // its spans are in the list
  entry.mask = entry.kind == CellKind::kBlock ? args.blocks[i] : OctantsOfCell(record);
  entry.first = FirstOfCell(record);
  entry.triangle = args.placed != nullptr ? args.placed[3 * i].triangle : uint32_t(i);
  return entry;
}

// Bit index of fragment n of an entry in the slab's bit grid.
__device__ inline uint32_t BitOfFragment(const CoverageShadingArgs& args, const CoverageEntry& entry, uint32_t n) {
  if (entry.kind == CellKind::kOther) return entry.first + n;
  const uint32_t i = SelectBit(entry.mask, n), log = entry.kind == CellKind::kBlock ? 2 : 1, side = (1u << log) - 1;
  const uint32_t row = uint32_t(args.grid.words_per_row) * 32, layer = row * uint32_t(args.grid.dims[1]);
  return entry.first + (i & side) + row * (i >> log & side) + layer * (i >> 2 * log);
}

// Shades and blends a triangle's fragment at the voxel of a bit index.
__device__ inline void ShadeAndBlend(const CoverageShadingArgs& args, const TriangleInput& triangle, uint32_t bit) {
  const uint32_t word = bit / 32, x = bit % 32;
  const uint32_t row = Quotient(word, args.by_words_per_row), z = Quotient(row, args.by_ny);
  const int64_t voxel[3] = {int64_t((word - row * args.by_words_per_row.divisor) * 32 + x),
                            int64_t(row - z * args.by_ny.divisor), int64_t(z) + args.grid.slab_begin};
  const FragmentInput in = InputAt(triangle, args.traits, voxel);
  const uint32_t rank = args.ranks.Of(word, x);
  bool kept = false;
  for (int t = 0; t < args.target_count; ++t) {
    const ShadedTarget& shaded = args.targets[t];
    FragmentOutput out;
    ShadeFragment(shaded.target.shader, in, shaded.target.params, out);
    if (out.discard) continue;
    kept = true;
    if (shaded.target.own_presence) atomicOr(shaded.target.presence + word, 1u << x);
    // `first` keeps the smallest id, `replace` the largest number: the same unless parts are filled.
    const bool by_number = shaded.has_owner && shaded.to.kept == Kept::kMax;
    BlendShaded(shaded, out, by_number ? in.triangle - in.part->id_offset : in.triangle, rank);
  }
  if (kept && args.coverage != nullptr) atomicOr(args.coverage + word, 1u << x);
}

__global__ void __launch_bounds__(kShadeThreads) ShadeCoverage(const __grid_constant__ CoverageShadingArgs args) {
  extern __shared__ double of_triangles[];
  auto* const triangles = reinterpret_cast<TriangleInput*>(of_triangles);
  __shared__ CoverageEntry entries[kShadeThreads];
  __shared__ uint32_t before[kShadeThreads], sums[kShadeThreads / 32];
  const uint64_t count = args.count;
  for (uint64_t begin = uint64_t(blockIdx.x) * kShadeThreads; begin < count;
       begin += uint64_t(gridDim.x) * kShadeThreads) {
    const uint64_t mine = begin + threadIdx.x;
    const CoverageEntry entry = mine < count ? LoadEntry(args, mine) : CoverageEntry{};
    entries[threadIdx.x] = entry;
    uint32_t of_warp;
    const uint32_t in_warp = WarpExclusiveSum(uint32_t(__popcll(entry.mask)), of_warp);
    if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = of_warp;
    if (entry.mask != 0) MakeTriangleInput(*args.mesh, args.traits, entry.triangle, triangles[threadIdx.x]);
    __syncthreads();
    uint32_t total = 0, earlier = 0;
#pragma unroll
    for (uint32_t w = 0; w < kShadeThreads / 32; ++w) {
      if (w == threadIdx.x / 32) earlier = total;
      total += sums[w];
    }
    before[threadIdx.x] = earlier + in_warp;
    __syncthreads();
    for (uint32_t f = threadIdx.x; f < total; f += kShadeThreads) {
      uint32_t i = 0;  // binary search: the last entry whose first fragment is not after f
#pragma unroll
      for (uint32_t step = kShadeThreads / 2; step > 0; step /= 2) {
        if (before[i + step] <= f) i += step;
      }
      ShadeAndBlend(args, triangles[i], BitOfFragment(args, entries[i], f - before[i]));
    }
    __syncthreads();  // the shared arrays are free
  }
}

}  // namespace voxelpipe::cuda
