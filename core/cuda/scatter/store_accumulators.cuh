// Converts blended keys and accumulators to values of the result, and lists owners. Included by store_values.cu only,
// because its kernels are not templates. No host-only includes.
#pragma once

#include "cuda/coverage/set_bits.cuh"
#include "cuda/primitives/part_order.h"
#include "cuda/scatter/blend_spans.cuh"
#include "cuda/shading/fragment_shading.cuh"

namespace voxelpipe::cuda {

// This warp's index in the grid, and the number of warps.
__device__ inline uint64_t GridWarp() {
  return uint64_t(blockIdx.x) * (kBlendThreads / 32) + threadIdx.x / 32;
}
__device__ inline uint64_t GridWarps() {
  return uint64_t(gridDim.x) * (kBlendThreads / 32);
}

struct KeyArgs {
  const uint32_t* coverage;  // bit grid
  const uint32_t* negative;  // as in InPlaceArgs
  uint32_t* out;
  uint64_t words, voxels;
  int64_t nx, words_per_row;
  int components;
  bool planar, complement, is_float;
};

__device__ inline uint32_t ValueOfCell(const KeyArgs& args, bool plain, uint32_t cell) {
  const uint32_t key = args.complement ? ~cell : cell;
  return args.is_float && !plain ? BitsOfKey(key) : key;
}
// There are fewer than 2^32 words, since each stands for 32 cells.
__device__ inline uint64_t VoxelOf(const KeyArgs& args, uint64_t word, uint32_t x) {
  const auto w = uint32_t(word), per_row = uint32_t(args.words_per_row), row = w / per_row;
  return uint64_t{row} * uint64_t(args.nx) + (w - row * per_row) * 32 + x;
}

// Converts four-component keys, 16 bytes per access.
__device__ inline void FoursToValues(const KeyArgs& args, bool plain) {
  constexpr int kAtOnce = 4;  // voxels per lane: all are read before any is written
  const uint64_t step = uint64_t(gridDim.x) * (kBlendThreads / 32) * kWordsOfWarp;
  uint64_t begin = (uint64_t(blockIdx.x) * (kBlendThreads / 32) + threadIdx.x / 32) * kWordsOfWarp;
  uint4* const cells = reinterpret_cast<uint4*>(args.out);
  for (; begin < args.words; begin += step) {
    const SetBits bits(args.coverage, begin, args.words);
    for (uint32_t first = 0; first < bits.total(); first += 32 * kAtOnce) {
      uint64_t voxel[kAtOnce];
      uint4 cell[kAtOnce];
#pragma unroll
      for (uint32_t i = 0; i < kAtOnce; ++i) {
        const uint32_t number = first + 32 * i + threadIdx.x % 32;
        if (first + 32 * i >= bits.total()) break;
        uint64_t word = 0;
        uint32_t x = 0;
        bits.Find(number, word, x);
        voxel[i] = VoxelOf(args, word, x);
        if (number < bits.total()) cell[i] = cells[voxel[i]];
      }
#pragma unroll
      for (uint32_t i = 0; i < kAtOnce; ++i) {
        if (first + 32 * i + threadIdx.x % 32 >= bits.total()) break;
        const uint4& c = cell[i];
        cells[voxel[i]] = {ValueOfCell(args, plain, c.x), ValueOfCell(args, plain, c.y), ValueOfCell(args, plain, c.z),
                           ValueOfCell(args, plain, c.w)};
      }
    }
  }
}

// Converts the keys of covered voxels to values. Supports programmatic dependent launch.
__global__ void __launch_bounds__(kBlendThreads) KeysToValues(const __grid_constant__ KeyArgs args) {
  AwaitEarlier();
  const bool plain = args.negative != nullptr && *args.negative == 0;
  if (plain && !args.complement) return;
  if (args.components == 4 && !args.planar) return FoursToValues(args, plain);
  ForEachSetBit(args.coverage, args.words, GridWarp(), GridWarps(), [&](uint64_t word, uint32_t x) {
    const uint64_t n = VoxelOf(args, word, x);
    for (uint64_t c = 0; c < uint64_t(args.components); ++c) {
      uint32_t* const cell = args.out + (args.planar ? c * args.voxels + n : n * uint64_t(args.components) + c);
      *cell = ValueOfCell(args, plain, *cell);
    }
  });
}

struct StoreArgs {
  Ranks ranks;
  Accumulators from;
  VoxelFormat format{};
  bool is_float = false, planar = false;
  double quantum = 1;
  const uint32_t* present = nullptr;  // bit grid: voxels in which the target has a fragment
  uint64_t words = 0;                 // of `present`
  uint64_t voxels = 0;                // of the result
  const uint32_t* listed = nullptr;   // sparse result: bit index of each voxel; null: dense result
  uint32_t nx = 0, words_per_row = 0;
  uint8_t* out = nullptr;    // values; or
  uint32_t* bits = nullptr;  // or a cleared bit grid
};

// Calls visit(word, bit, rank, element of the result) for every voxel in which the target has a fragment, one voxel per
// lane.
template <typename Visit>
__device__ inline void ForEachStored(const StoreArgs& args, Visit&& visit) {
  if (args.listed == nullptr) {
    ForEachSetBit(args.present, args.words, GridWarp(), GridWarps(), [&](uint64_t word, unsigned x) {
      visit(uint32_t(word), x, args.ranks.Of(uint32_t(word), x),
            VoxelOfBit(uint32_t(word) * 32 + x, args.nx, args.words_per_row));
    });
    return;
  }
  const uint64_t threads = uint64_t(gridDim.x) * kBlendThreads;
  for (uint64_t i = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x; i < args.voxels; i += threads) {
    const uint32_t word = args.listed[i] / 32, x = args.listed[i] % 32;
    if ((args.present[word] >> x & 1) != 0) visit(word, x, args.ranks.Of(word, x), i);
  }
}

// Converts accumulators of covered voxels to values of the result.
__global__ void __launch_bounds__(kBlendThreads) StoreAccumulated(const __grid_constant__ StoreArgs args) {
  const Accumulators& from = args.from;
  ForEachStored(args, [&](uint32_t word, uint32_t x, uint32_t rank, uint64_t n) {
    for (uint64_t c = 0; c < uint64_t(from.components); ++c) {
      const uint32_t stored = StoredOf(from, rank, int(c), args.format, args.is_float, args.quantum);
      if (args.format == VoxelFormat::kBit) {
        if (stored != 0) atomicOr(args.bits + word, 1u << x);
        continue;
      }
      PutElement(args.out, args.format, args.planar ? c * args.voxels + n : n * uint64_t(from.components) + c, stored);
    }
  });
}

// Outputs of ListOwners: a target's voxels, their owners, and output elements.
struct OwnerListArgs {
  StoreArgs from;                // accumulators that hold owners
  const IdRun* by_id = nullptr;  // if they hold ids, and triangles have other numbers
  uint32_t id_runs = 0;
  uint32_t *keys = nullptr, *triangles = nullptr,
           *to = nullptr;  // output elements: of a dense result by rank, of a sparse one in list order
};

__global__ void __launch_bounds__(kBlendThreads) ListOwners(const __grid_constant__ OwnerListArgs args) {
  const StoreArgs& from = args.from;
  ForEachStored(from, [&](uint32_t word, uint32_t x, uint32_t rank, uint64_t n) {
    const uint64_t i = from.listed == nullptr ? rank : n;
    args.keys[i] = uint32_t(VoxelOfBit(word * 32 + x, from.nx, from.words_per_row));
    const uint32_t owner = from.from.cells[rank] - 1;
    args.triangles[i] = args.by_id == nullptr ? owner : NumberOf(args.by_id, args.id_runs, owner);
    args.to[i] = from.format == VoxelFormat::kBit ? word * 32 + x : uint32_t(n);
  });
}

}  // namespace voxelpipe::cuda
