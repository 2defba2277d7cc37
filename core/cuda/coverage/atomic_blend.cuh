// Blends that are a single 32-bit atomic on a cell of the dense target (blend_spans.cuh). No host-only includes.
#pragma once

#include "cuda/primitives/fast_normal.cuh"
#include "cuda/primitives/flat_value.cuh"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

enum class InPlace : uint8_t { kMax, kMaxOfComplement, kOr, kCount };

struct InPlaceArgs {
  const uint64_t* spans = nullptr;
  uint64_t count = 0;
  uint32_t first_triangle = 0;  // as in SpanArgs
  const uint32_t* values = nullptr;
  FlatShading shading;        // to shade the target if there are no `values`
  DegenerateTest degenerate;  // if the values are normals
  // Float keys: 0 if no value is negative, so that plain float bits can be blended. Null: never, or not floats.
  const uint32_t* negative = nullptr;
  uint32_t* out = nullptr;
  InPlace blend{};
  bool planar = false;
  uint64_t voxels = 0;  // of the slab
  uint32_t nx = 0, words_per_row = 0;
};

// Voxel index of a bit in a grid whose rows are padded to whole words.
__device__ inline uint64_t VoxelOfBit(uint32_t bit, uint32_t nx, uint32_t words_per_row) {
  if (nx == words_per_row * 32) return bit;
  const uint32_t row = bit / 32 / words_per_row;
  return uint64_t{row} * nx + (bit - row * words_per_row * 32);
}

template <int kComponents>
__device__ inline void LoadValues(const uint32_t* from, uint32_t (&to)[kComponents]) {
  if constexpr (kComponents == 4) {
    const uint4 all = *reinterpret_cast<const uint4*>(from);
    to[0] = all.x, to[1] = all.y, to[2] = all.z, to[3] = all.w;
  } else {
#pragma unroll
    for (int c = 0; c < kComponents; ++c) to[c] = from[c];
  }
}

// Reads cells that other threads write concurrently: current or slightly stale values. For several components only: for
// one, the read costs as much as the atomic. `blank` is a value that every blend changes.
template <int kComponents>
__device__ inline void LookAtCells(const uint32_t* from, uint32_t blank, uint32_t (&to)[kComponents]) {
  if constexpr (kComponents == 4) {
    const uint4 all = __ldca(reinterpret_cast<const uint4*>(from));
    to[0] = all.x, to[1] = all.y, to[2] = all.z, to[3] = all.w;
  } else {
#pragma unroll
    for (int c = 0; c < kComponents; ++c) to[c] = kComponents == 1 ? blank : __ldca(from + c);
  }
}

// Values of the kernels' kShader parameter: kNormalShader computes geometric normals; the id of the triangle-id shader
// computes ids; -1 reads precomputed values.
inline constexpr int kNormalShader = -2;

// Mask that turns min blends into max blends of keys: all bits set for a minimum.
VOXELPIPE_HD uint32_t FlipOf(const InPlaceArgs& args) {
  return args.blend == InPlace::kMaxOfComplement ? ~0u : 0;
}
// Keys for a max blend of a unit normal and of the default fourth component of shaders.
__device__ inline uint4 KeysOfUnit(const Vec3f& n, uint32_t flip) {
  const auto key = [flip](float v) {  // KeyOf, complemented for a minimum
    const uint32_t bits = BitsOf(v);
    return bits ^ ((uint32_t(int32_t(bits) >> 31) | 0x80000000u) ^ flip);
  };
  return {key(n.x), key(n.y), key(n.z), key(FragmentOutput().f[3])};
}
// The keys of a triangle's normal.
__device__ inline uint4 KeysOfNormal(const InPlaceArgs& args, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return KeysOfUnit(IsDegenerate(args.degenerate, a, b, c) ? Vec3f{} : QuickNormal(a, b, c), FlipOf(args));
}

// A triangle's key as owner of a voxel: the maximum wins for replace, the minimum for first. Never 0.
VOXELPIPE_HD uint32_t OwnerOf(uint32_t triangle) {
  return triangle + 1;
}

// The value of triangle t in the target's encoding. kShader: the triangle-id shader, which is cheaper than reading
// precomputed values; -1: reads them.
template <int kShader, int kComponents>
__device__ inline void ValuesOf(const uint32_t* values, const FlatShading& shading, uint32_t t,
                                uint32_t (&to)[kComponents]) {
  if constexpr (kShader >= 0 && kComponents == 1) {  // ids without the code of other formats and blends
    if (shading.has_owner()) {
      to[0] = OwnerOf(t);
      return;
    }
    const bool ordered = shading.kept == Kept::kMax || shading.kept == Kept::kMin;
    if (ordered && shading.target.format == VoxelFormat::kF32) {
      to[0] = KeyOf(BitsOf(float(t)));
      return;
    }
    if (ordered && shading.target.format == VoxelFormat::kU32) {
      to[0] = t;
      return;
    }
  }
  if constexpr (kShader >= 0) {
    UniformValue value;
    ShadeUniformAs(shading, FragmentShaderId(kShader), MakePlainInput(*shading.mesh, t), value);
#pragma unroll
    for (int c = 0; c < kComponents; ++c) to[c] = uint32_t(value.component[c]);
  } else {
    LoadValues<kComponents>(values + uint64_t{t} * kComponents, to);
  }
}
// The same as keys for a max blend, if the blend is a min or max.
template <int kShader, int kComponents>
__device__ inline void KeysOf(const InPlaceArgs& args, bool plain, uint32_t t, uint32_t (&to)[kComponents]) {
  if (args.blend == InPlace::kCount) return;
  if constexpr (kShader == kNormalShader) {
    static_assert(kComponents == 4);
    const MeshView& mesh = *args.shading.mesh;
    const uint32_t* const v = mesh.triangles[t];
    const uint4 keys = KeysOfNormal(args, mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]);
    to[0] = keys.x, to[1] = keys.y, to[2] = keys.z, to[3] = keys.w;
    return;
  }
  ValuesOf<kShader, kComponents>(args.values, args.shading, t, to);
#pragma unroll
  for (int c = 0; c < kComponents; ++c) {
    if (plain) to[c] ^= 0x80000000u;
    if (args.blend == InPlace::kMaxOfComplement) to[c] = ~to[c];
  }
}
__device__ inline uint32_t CombineKeys(const InPlaceArgs& args, uint32_t a, uint32_t b) {
  return args.blend == InPlace::kOr ? a | b : max(a, b);
}

// Blends the contribution of `count` triangles into voxel n. Cells only grow, so no atomic is needed if a cell is
// already large enough.
template <int kComponents>
__device__ inline void BlendAt(const InPlaceArgs& args, uint64_t n, const uint32_t (&value)[kComponents],
                               uint32_t count) {
  if (args.blend == InPlace::kCount || args.blend == InPlace::kOr || (kComponents > 1 && args.planar)) {
#pragma unroll
    for (int c = 0; c < kComponents; ++c) {
      uint32_t* const cell = args.out + (args.planar ? uint64_t(c) * args.voxels + n : n * kComponents + uint64_t(c));
      if (args.blend == InPlace::kCount) {
        atomicAdd(cell, count);
      } else if (args.blend == InPlace::kOr) {
        atomicOr(cell, value[c]);
      } else if (__ldca(cell) < value[c]) {
        atomicMax(cell, value[c]);
      }
    }
    return;
  }
  uint32_t* const cells = args.out + n * kComponents;
  uint32_t now[kComponents];
  LookAtCells<kComponents>(cells, 0, now);
#pragma unroll
  for (int c = 0; c < kComponents; ++c) {
    if (now[c] < value[c]) atomicMax(cells + c, value[c]);
  }
}

}  // namespace voxelpipe::cuda
