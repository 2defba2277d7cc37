// Blends that are one 32-bit atomic on a dense target's cell (blend_spans.cuh). No host-only includes.
#pragma once

#include "cuda/primitives/fast_normal.cuh"
#include "cuda/primitives/flat_value.cuh"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

enum class InPlace : uint8_t { kMax, kMaxOfComplement, kOr, kCount };

struct InPlaceArgs {
  const uint64_t* spans = nullptr;
  uint64_t count = 0;
  uint32_t first_triangle = 0;  // SpanArgs'
  const uint32_t* values = nullptr;
  FlatShading shading;                 // of the target, where there are no values
  DegenerateTest degenerate;           // where they are normals
  const uint32_t* negative = nullptr;  // of keys of floats: 0 where they may go plain; null: never, or others
  uint32_t* out = nullptr;
  InPlace blend{};
  bool planar = false;
  uint64_t voxels = 0;  // of the slab
  uint32_t nx = 0, words_per_row = 0;
};

// The voxel of a bit of a grid whose rows are padded to whole words.
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

// Cells that others write meanwhile, as they are now or were a little before. Only of several: to look costs as much as
// one atomic. `blank` is what every value changes.
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

// The kShader of kernels that make geometric normals; as others have it, that of triangle ids is a shader's number, and
// -1 says that values stand ready.
inline constexpr int kNormalShader = -2;

// Of keys of which the largest is sought; all bits set where that is the least of what they are made of.
VOXELPIPE_HD uint32_t FlipOf(const InPlaceArgs& args) {
  return args.blend == InPlace::kMaxOfComplement ? ~0u : 0;
}
// The keys of a unit normal, and of what shaders leave the fourth component at, of which the largest is sought.
__device__ inline uint4 KeysOfUnit(const Vec3f& n, uint32_t flip) {
  const auto key = [flip](float v) {  // KeyOf, and turned round
    const uint32_t bits = BitsOf(v);
    return bits ^ ((uint32_t(int32_t(bits) >> 31) | 0x80000000u) ^ flip);
  };
  return {key(n.x), key(n.y), key(n.z), key(FragmentOutput().f[3])};
}
// Of a triangle.
__device__ inline uint4 KeysOfNormal(const InPlaceArgs& args, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return KeysOfUnit(IsDegenerate(args.degenerate, a, b, c) ? Vec3f{} : QuickNormal(a, b, c), FlipOf(args));
}

// A triangle as the owner of a voxel: the largest wins under replace, the least under first. Never 0.
VOXELPIPE_HD uint32_t OwnerOf(uint32_t triangle) {
  return triangle + 1;
}

// What triangle t brings, as the target keeps it. kShader: that of triangle ids, which is cheaper than to read what was
// made before; -1, of any other: values stand ready.
template <int kShader, int kComponents>
__device__ inline void ValuesOf(const uint32_t* values, const FlatShading& shading, uint32_t t,
                                uint32_t (&to)[kComponents]) {
  if constexpr (kShader >= 0 && kComponents == 1) {  // largest and least ids without what other formats and blends need
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
// The same as keys of which the largest is sought, where it is a largest.
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

// Blends what `count` triangles bring into voxel n. A cell only grows, so one that was seen to be large enough needs no
// atomic.
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
