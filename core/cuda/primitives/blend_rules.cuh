// One tile of one render target in shared memory while it is blended: the device's twin of cpu/tile_buffer.h.
//
// Fragments arrive in any order, so every blend is an atomic whose result no order changes. Floats are kept as keys
// whose unsigned order is theirs; replace and first find the winning triangle of each voxel in one pass and write its
// value in a second.
#pragma once

#include "cuda/primitives/views.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cuda {

// What is kept of a voxel.
enum class Kept : uint8_t {
  kNothing,     // the coverage itself
  kBitOr,       // a bit, set where any fragment's is
  kBitAnd,      // a bit, clear where any fragment's is
  kBitOfOwner,  // a bit, of the owner
  kOwner,       // cells, of the owner
  kMin,         // cells; floats as keys
  kMax,
  kOr,
  kAnd,
  kSum,      // 64 bits a component
  kAverage,  // likewise, and the number of fragments
  kCount,    // the number of fragments
};

// A target in a tile. Offsets into the block's shared memory in 32-bit words, even; only those that `kept` needs are
// used.
struct TileTarget {
  CudaTarget target;
  int index = 0;  // of the request's targets
  Kept kept = Kept::kNothing;
  bool is_float = false;
  int bits = 0, presence = 0, owner = 0, cells = 0, sums = 0, counts = 0;

  VOXELPIPE_HD bool has_owner() const { return kept == Kept::kBitOfOwner || kept == Kept::kOwner; }
};

VOXELPIPE_HD Kept KeptBy(const CudaTarget& t) {
  if (t.is_occupancy) return Kept::kNothing;
  const bool bit = t.format == VoxelFormat::kBit;
  switch (t.blend) {
    case Blend::kOr: return bit ? Kept::kBitOr : Kept::kOr;
    case Blend::kAnd: return bit ? Kept::kBitAnd : Kept::kAnd;
    case Blend::kReplace:
    case Blend::kFirst: return bit ? Kept::kBitOfOwner : Kept::kOwner;
    case Blend::kMin: return Kept::kMin;
    case Blend::kMax: return Kept::kMax;
    case Blend::kAdd: return Kept::kSum;
    case Blend::kAverage: return Kept::kAverage;
    case Blend::kCount: return bit ? Kept::kBitOr : Kept::kCount;
  }
  return Kept::kNothing;
}
// True if what is kept of a voxel is blended from values alone, whichever triangle they are of.
VOXELPIPE_HD bool IsUniformKept(Kept kept) {
  return kept != Kept::kNothing && kept != Kept::kOwner && kept != Kept::kBitOfOwner;
}

// Gives the target its place in shared memory from word `at` on; returns the first word behind it.
VOXELPIPE_HD int PlaceTileTarget(TileTarget& t, int at) {
  t.kept = KeptBy(t.target);
  t.is_float = t.target.format == VoxelFormat::kF16 || t.target.format == VoxelFormat::kF32;
  const int cells = kTileVoxels * t.target.components;
  const auto take = [&](int words) {
    const int here = at;
    at += words;
    return here;
  };
  if (t.target.own_presence) t.presence = take(kTileRows);
  switch (t.kept) {
    case Kept::kNothing: break;
    case Kept::kBitOfOwner: t.owner = take(kTileVoxels); [[fallthrough]];
    case Kept::kBitOr:
    case Kept::kBitAnd: t.bits = take(kTileRows); break;
    case Kept::kOwner: t.owner = take(kTileVoxels); [[fallthrough]];
    case Kept::kMin:
    case Kept::kMax:
    case Kept::kOr:
    case Kept::kAnd: t.cells = take(cells); break;
    case Kept::kAverage: t.counts = take(kTileVoxels); [[fallthrough]];
    case Kept::kSum: t.sums = take(2 * cells); break;
    case Kept::kCount: t.counts = take(kTileVoxels); break;
  }
  return at;
}

// Unsigned order of keys is the order of OrderedLess (blend_ops.h).
VOXELPIPE_HD uint32_t KeyOf(uint32_t float_bits) {
  return (float_bits >> 31) != 0 ? ~float_bits : float_bits | 0x80000000u;
}
VOXELPIPE_HD uint32_t BitsOfKey(uint32_t key) {
  return (key >> 31) != 0 ? key & 0x7fffffffu : ~key;
}

// Largest for the triangle that wins: the highest id under replace, the lowest under first. Never 0.
VOXELPIPE_HD uint32_t OwnerKey(Blend blend, uint32_t triangle) {
  return blend == Blend::kFirst ? ~triangle : triangle + 1;
}

#if defined(__CUDACC__) || defined(__CUDACC_RTC__)

// Sets the target's part of shared memory to where blending starts. All threads of the block.
__device__ inline void BeginTile(const TileTarget& t, uint32_t* shared, int thread, int threads) {
  const auto fill = [&](int at, int words, uint32_t value) {
    for (int i = thread; i < words; i += threads) shared[at + i] = value;
  };
  const int cells = kTileVoxels * t.target.components;
  if (t.target.own_presence) fill(t.presence, kTileRows, 0);
  if (t.has_owner()) fill(t.owner, kTileVoxels, 0);
  switch (t.kept) {
    case Kept::kNothing: break;
    case Kept::kBitOr:
    case Kept::kBitOfOwner: fill(t.bits, kTileRows, 0); break;
    case Kept::kBitAnd: fill(t.bits, kTileRows, ~0u); break;
    case Kept::kOwner: break;
    case Kept::kMin:
    case Kept::kAnd: fill(t.cells, cells, ~0u); break;
    case Kept::kMax:
    case Kept::kOr: fill(t.cells, cells, 0); break;
    case Kept::kAverage: fill(t.counts, kTileVoxels, 0); [[fallthrough]];
    case Kept::kSum: fill(t.sums, 2 * cells, 0); break;
    case Kept::kCount: fill(t.counts, kTileVoxels, 0); break;
  }
}

// Blends one fragment into voxel x + 32*row of the tile; not for targets with an owner.
__device__ inline void BlendFragment(const TileTarget& t, uint32_t* shared, int row, int x, const FragmentOutput& out) {
  const CudaTarget& target = t.target;
  const int voxel = row * 32 + x;
  const uint32_t mask = 1u << x;
  if (target.own_presence) atomicOr(shared + t.presence + row, mask);
  switch (t.kept) {
    case Kept::kBitOr:
      if (target.blend == Blend::kCount || ToBit(out, target.u32_output)) atomicOr(shared + t.bits + row, mask);
      return;
    case Kept::kBitAnd:
      if (!ToBit(out, target.u32_output)) atomicAnd(shared + t.bits + row, ~mask);
      return;
    case Kept::kCount: atomicAdd(shared + t.counts + voxel, 1u); return;
    case Kept::kAverage: atomicAdd(shared + t.counts + voxel, 1u); [[fallthrough]];
    case Kept::kSum: {
      auto* const sums = reinterpret_cast<unsigned long long*>(shared + t.sums) + voxel * target.components;
      for (int c = 0; c < target.components; ++c) {
        atomicAdd(sums + c, static_cast<unsigned long long>(
                                ToTerm(out, target.u32_output, c, target.format, target.scale, target.quantum)));
      }
      return;
    }
    default: break;
  }
  uint32_t* const cells = shared + t.cells + voxel * target.components;
  for (int c = 0; c < target.components; ++c) {
    uint32_t v = ToCell(out, target.u32_output, c, target.format, target.scale);
    switch (t.kept) {
      case Kept::kMin: atomicMin(cells + c, t.is_float ? KeyOf(v) : v); break;
      case Kept::kMax: atomicMax(cells + c, t.is_float ? KeyOf(v) : v); break;
      case Kept::kOr: atomicOr(cells + c, v); break;
      default: atomicAnd(cells + c, v); break;
    }
  }
}

// The owner's fragment of a voxel.
__device__ inline void WriteOwner(const TileTarget& t, uint32_t* shared, int row, int x, const FragmentOutput& out) {
  const CudaTarget& target = t.target;
  if (t.kept == Kept::kBitOfOwner) {
    if (ToBit(out, target.u32_output)) atomicOr(shared + t.bits + row, 1u << x);
    return;
  }
  uint32_t* const cells = shared + t.cells + (row * 32 + x) * target.components;
  for (int c = 0; c < target.components; ++c) {
    cells[c] = ToCell(out, target.u32_output, c, target.format, target.scale);
  }
}

// Component c of a voxel with a fragment, as stored; not for bit targets.
__device__ inline uint32_t StoredAt(const TileTarget& t, const uint32_t* shared, int voxel, int c) {
  const CudaTarget& target = t.target;
  const int at = voxel * target.components + c;
  switch (t.kept) {
    case Kept::kSum:
      return StoreSum(reinterpret_cast<const int64_t*>(shared + t.sums)[at], target.format, target.quantum, c);
    case Kept::kAverage:
      return StoreAverage(reinterpret_cast<const int64_t*>(shared + t.sums)[at], shared[t.counts + voxel],
                          target.format, target.quantum, c);
    case Kept::kCount: return StoreCount(shared[t.counts + voxel], target.format);
    case Kept::kMin:
    case Kept::kMax: {
      const uint32_t cell = shared[t.cells + at];
      return StoredBits(t.is_float ? BitsOfKey(cell) : cell, target.format);
    }
    default: return StoredBits(shared[t.cells + at], target.format);
  }
}

#endif

}  // namespace voxelpipe::cuda
