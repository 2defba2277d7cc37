// Kernels for items of a batch whose targets have values: rank the touched voxels, shade every fragment and blend it
// into the accumulators of its voxel, then convert accumulators to values (core/cuda/README.md, "Coverage, then shade,
// then blend"). No host-only includes.
#pragma once

#include "cuda/batch/batch_bits.cuh"
#include "cuda/coverage/set_bits.cuh"
#include "cuda/shading/blend_fragment.cuh"
#include "cuda/shading/fragment_shading.cuh"

namespace voxelpipe::cuda {

inline constexpr int kValueThreads = 256, kRankThreads = 1024;

// Traversal operation that sets the bits that a triangle touches and counts its fragments.
struct CountAndSetBits {
  SetBatchBits<&BatchItemView::first_touched> bits;
  CountFragments count;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t t) {
    bits.Begin(t);
    count.Begin(t);
  }
  __device__ void Row(int y, int z, int x_begin, int x_end) {
    bits.Row(y, z, x_begin, x_end);
    count.Row(y, z, x_begin, x_end);
  }
  __device__ void End(uint32_t t) const { count.End(t); }
  __device__ void Finish() const {}
  __device__ void SharedRow(uint32_t t, int y, int z, int x_begin, int x_end) const {
    bits.SharedRow(t, y, z, x_begin, x_end);
    count.SharedRow(t, y, z, x_begin, x_end);
  }
};

// Ranks the touched voxels of each item in batch.word_ranks, one block per item. touched[k] receives their number for
// item first_item + k. `firsts`: offsets of the fragments of triangles from first_triangle on, for the item's fragment
// count.
__global__ void __launch_bounds__(kRankThreads)
    RankItems(const __grid_constant__ BatchView batch, uint32_t first_item, uint64_t first_triangle,
              const uint64_t* firsts, uint32_t* touched) {
  __shared__ uint32_t sums[kRankThreads / 32];
  const uint32_t number = first_item + blockIdx.x;
  const BatchItemView& item = batch.items[number];
  const uint32_t* const bits = batch.bits + item.first_touched;
  uint32_t* const ranks = batch.word_ranks + item.first_touched;
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  uint32_t before = 0;  // sum over all words before the current ones
  for (uint64_t begin = 0; begin < item.words; begin += kRankThreads) {
    const uint64_t w = begin + threadIdx.x;
    const uint32_t count = w < item.words ? uint32_t(__popc(bits[w])) : 0;
    uint32_t of_warp;
    const uint32_t in_warp = WarpExclusiveSum(count, of_warp);
    if (lane == 0) sums[warp] = of_warp;
    __syncthreads();
    uint32_t all;
    const uint32_t earlier = __shfl_sync(~0u, WarpExclusiveSum(sums[lane], all), int(warp));
    if (w < item.words) ranks[w] = before + earlier + in_warp;
    before += all;
    __syncthreads();  // `sums` may be overwritten
  }
  if (threadIdx.x != 0) return;
  touched[blockIdx.x] = before;
  const uint64_t first = item.first_triangle - first_triangle;
  batch.counts[number].fragments = firsts[first + item.triangle_count] - firsts[first];
}
static_assert(kRankThreads / 32 == 32);  // one lane per warp

__device__ inline Ranks RanksOf(const BatchView& batch, const BatchItemView& item) {
  return {batch.bits + item.first_touched, batch.word_ranks + item.first_touched};
}

// True if fragments are blended without running the shader.
VOXELPIPE_HD bool NeedsNoShading(const ShadedTarget& shaded) {
  return !shaded.target.own_presence && (shaded.has_owner || shaded.to.kept == Kept::kCount);
}

// One thread per fragment.
__global__ void __launch_bounds__(kValueThreads)
    BlendBatchFragments(const __grid_constant__ BatchView batch, const ShadedTarget* targets, const uint32_t* keys,
                        const uint32_t* triangles, uint64_t count) {
  for (uint64_t i = uint64_t(blockIdx.x) * kValueThreads + threadIdx.x; i < count;
       i += uint64_t(gridDim.x) * kValueThreads) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_voxel, keys[i])];
    const BatchShading& shading = item.shading;
    FragmentInput in;
    if (shading.shades) {
      FragmentShading list;
      list.grid = &item.grid;
      list.mesh = shading.mesh;
      list.traits = shading.traits;
      list.first_key = item.first_voxel;
      list.keys = keys;
      list.triangles = triangles;
      PlaceFragment(list, i, in);
    }
    const auto nx = uint32_t(item.grid.dims[0]), voxel = uint32_t(keys[i] - item.first_voxel), row = voxel / nx;
    const uint32_t x = voxel - row * nx, word = row * uint32_t(item.grid.words_per_row) + x / 32, bit = 1u << x % 32;
    const uint32_t rank = RanksOf(batch, item).Of(word, x % 32);
    bool kept = false;
    for (int t = 0; t < shading.target_count; ++t) {
      const ShadedTarget& shaded = targets[shading.first_target + uint32_t(t)];
      FragmentOutput out;
      if (!NeedsNoShading(shaded)) ShadeFragment(shaded.target.shader, in, shaded.target.params, out);
      if (out.discard) continue;
      kept = true;
      if (shaded.target.own_presence) atomicOr(shaded.target.presence + word, bit);
      BlendShaded(shaded, out, triangles[i], rank);
    }
    if (kept && shading.drops) atomicOr(batch.bits + item.first_word + word, bit);
  }
}

// Shades the owner of a voxel.
__device__ inline void StoreOwner(const BatchItemView& item, const CudaTarget& target, uint32_t triangle, uint32_t word,
                                  uint32_t x, uint64_t n) {
  const ShaderTraits traits = TraitsOf(target.shader);
  TriangleInput of_triangle;
  MakeTriangleInput(*item.shading.mesh, traits, triangle, of_triangle);
  const uint32_t row = word / uint32_t(item.grid.words_per_row), z = row / uint32_t(item.grid.dims[1]);
  const int64_t voxel[3] = {int64_t(word - row * uint32_t(item.grid.words_per_row)) * 32 + x,
                            int64_t(row) - int64_t(z) * item.grid.dims[1], int64_t(z)};
  FragmentOutput out;
  ShadeFragment(target.shader, InputAt(of_triangle, traits, voxel), target.params, out);
  if (target.format == VoxelFormat::kBit) {
    if (ToBit(out, target.u32_output)) atomicOr(target.bits + word, 1u << x);
    return;
  }
  const auto voxels = uint64_t(item.grid.dims[0] * item.grid.dims[1] * item.grid.dims[2]);
  for (uint64_t c = 0; c < uint64_t(target.components); ++c) {
    const uint32_t cell = ToCell(out, target.u32_output, int(c), target.format, target.scale);
    PutElement(target.dense, target.format, item.shading.planar ? c * voxels + n : n * uint64_t(target.components) + c,
               StoredBits(cell, target.format));
  }
}

// Converts accumulators to values of covered voxels. gridDim.x distributes targets, gridDim.y the words of each.
__global__ void __launch_bounds__(kValueThreads)
    StoreBatchValues(const __grid_constant__ BatchView batch, const ShadedTarget* targets, const uint32_t* item_of,
                     uint32_t count) {
  const uint64_t warp = uint64_t(blockIdx.y) * (kValueThreads / 32) + threadIdx.x / 32,
                 warps = uint64_t(gridDim.y) * (kValueThreads / 32);
  for (uint32_t i = blockIdx.x; i < count; i += gridDim.x) {
    const ShadedTarget& shaded = targets[i];
    const CudaTarget& target = shaded.target;
    const BatchItemView& item = batch.items[item_of[i]];
    const Ranks ranks = RanksOf(batch, item);
    const uint32_t* const present = target.own_presence ? target.presence : batch.bits + item.first_word;
    const auto voxels = uint64_t(item.grid.dims[0] * item.grid.dims[1] * item.grid.dims[2]);
    ForEachSetBit(present, item.words, warp, warps, [&](uint64_t at, uint32_t x) {
      const auto word = uint32_t(at);
      const uint32_t rank = ranks.Of(word, x);
      const uint64_t n = VoxelOfBit(word * 32 + x, uint32_t(item.grid.dims[0]), uint32_t(item.grid.words_per_row));
      if (shaded.has_owner) return StoreOwner(item, target, shaded.to.cells[rank] - 1, word, x, n);
      for (uint64_t c = 0; c < uint64_t(shaded.to.components); ++c) {
        const uint32_t stored = StoredOf(shaded.to, rank, int(c), target.format, shaded.is_float, target.quantum);
        if (target.format == VoxelFormat::kBit) {
          if (stored != 0) atomicOr(target.bits + word, 1u << x);
          continue;
        }
        PutElement(target.dense, target.format,
                   item.shading.planar ? c * voxels + n : n * uint64_t(target.components) + c, stored);
      }
    });
  }
}

}  // namespace voxelpipe::cuda
