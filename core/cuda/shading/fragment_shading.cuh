// Runs fragment shaders on a list of independent fragments. No host-only includes.
#pragma once

#include "cuda/primitives/views.h"
#include "raster/triangle_plane.h"
#include "shaders/blend_ops.h"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cuda {

// Shader inputs shared by all fragments of a triangle.
struct TriangleInput {
  FragmentInput in;     // except voxel and barycentrics
  TrianglePlane plane;  // if the shaders need barycentrics
};

__device__ inline void MakeTriangleInput(const MeshView& mesh, const ShaderTraits& traits, uint32_t t,
                                         TriangleInput& out) {
  if (!traits.needs_plane) {
    out.in = MakePlainInput(mesh, t);
    return;
  }
  const uint32_t* v = mesh.triangles[t];
  const Vec3d* p = mesh.index_positions;
  out.plane = SetUpPlane(p[v[0]], p[v[1]], p[v[2]]);
  out.in = MakeFragmentInput(mesh, t, out.plane.degenerate, traits.reads_textures());
}

// Shader input of the triangle's fragment at a voxel of the grid.
__device__ inline FragmentInput InputAt(const TriangleInput& triangle, const ShaderTraits& traits,
                                        const int64_t (&voxel)[3]) {
  FragmentInput in = triangle.in;
  for (int a = 0; a < 3; ++a) in.voxel[a] = voxel[a];
  if (traits.needs_barycentrics) in.barycentric = Barycentrics(triangle.plane, voxel[0], voxel[1], voxel[2]);
  return in;
}

inline constexpr uint32_t kNoTriangleListed = ~0u;  // an unused list element

// A list of fragments of one grid and one mesh, and its outputs.
struct FragmentShading {
  const GridView* grid = nullptr;
  const MeshView* mesh = nullptr;
  const CudaTarget* targets = nullptr;
  int target_count = 0;
  ShaderTraits traits;  // union over all targets' shaders
  bool planar = false;
  const uint32_t* keys = nullptr;  // voxel index within the grid's slab, plus first_key
  uint64_t first_key = 0;
  const uint32_t* triangles = nullptr;
  uint64_t count = 0;
  const uint32_t* to = nullptr;   // output element of each fragment; null: its position in the list
  uint64_t plane = 0;             // elements of a plane of `out`; 0: the length of the list
  uint8_t* const* out = nullptr;  // per target, in the result's layout, padded to whole words
};

__device__ inline void PlaceFragment(const FragmentShading& s, uint64_t i, FragmentInput& in) {
  int64_t voxel[3];
  const uint32_t index = s.keys[i] - uint32_t(s.first_key);
  const auto nx = uint32_t(s.grid->dims[0]), ny = uint32_t(s.grid->dims[1]), row = index / nx, z = row / ny;
  voxel[0] = index - row * nx, voxel[1] = row - z * ny, voxel[2] = z;
  voxel[2] += s.grid->slab_begin;
  TriangleInput triangle;
  MakeTriangleInput(*s.mesh, s.traits, s.triangles[i], triangle);
  in = InputAt(triangle, s.traits, voxel);
}

// True if some target keeps the fragment.
__device__ inline bool IsKept(const FragmentShading& s, uint64_t i) {
  FragmentInput in;
  PlaceFragment(s, i, in);
  bool kept = false;
  for (int t = 0; t < s.target_count && !kept; ++t) {
    FragmentOutput out;
    ShadeFragment(s.targets[t].shader, in, s.targets[t].params, out);
    kept = !out.discard;
  }
  return kept;
}

__device__ inline void PutElement(uint8_t* out, VoxelFormat format, uint64_t at, uint32_t stored) {
  switch (format) {
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: out[at] = uint8_t(stored); break;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm:
    case VoxelFormat::kF16: reinterpret_cast<uint16_t*>(out)[at] = uint16_t(stored); break;
    default: reinterpret_cast<uint32_t*>(out)[at] = stored; break;
  }
}

// Writes the values of all targets. All threads of a warp call it with 32 consecutive fragments from a multiple of 32
// on, some of which may lie past the end: the warp writes the bits of a bit target as one word. With `to`, bits are set
// one by one in a cleared bit grid.
__device__ inline void WriteValues(const FragmentShading& s, uint64_t i) {
  const bool real = i < s.count && s.triangles[i] != kNoTriangleListed;
  FragmentInput in;
  if (real) PlaceFragment(s, i, in);
  const uint64_t at = real && s.to != nullptr ? s.to[i] : i, plane = s.plane > 0 ? s.plane : s.count;
  for (int t = 0; t < s.target_count; ++t) {
    const CudaTarget& target = s.targets[t];
    FragmentOutput out;
    if (real) ShadeFragment(target.shader, in, target.params, out);
    if (target.format == VoxelFormat::kBit) {
      const bool bit = real && (out.discard ? target.clear_stored != 0 : ToBit(out, target.u32_output));
      auto* const words = reinterpret_cast<uint32_t*>(s.out[t]);
      if (s.to != nullptr) {
        if (bit) atomicOr(words + at / 32, 1u << (at % 32));
        continue;
      }
      const uint32_t word = __ballot_sync(~0u, bit);
      if (threadIdx.x % 32 == 0) words[i / 32] = word;
      continue;
    }
    if (!real) continue;
    const auto components = uint64_t(target.components);
    for (uint64_t c = 0; c < components; ++c) {
      const uint32_t stored =
          out.discard ? target.clear_stored
                      : StoredBits(ToCell(out, target.u32_output, int(c), target.format, target.scale), target.format);
      PutElement(s.out[t], target.format, s.planar ? c * plane + at : at * components + c, stored);
    }
  }
}

}  // namespace voxelpipe::cuda
