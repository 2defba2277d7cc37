// Shaders on the A-buffer's fragments, each by itself. No host-only includes.
#pragma once

#include "cuda/views.h"
#include "shaders/blend_ops.h"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cuda {

// Fragments of one grid and one mesh.
struct FragmentShading {
  const GridView* grid = nullptr;
  const MeshView* mesh = nullptr;
  const CudaTarget* targets = nullptr;
  int target_count = 0;
  ShaderTraits traits;  // of all targets' shaders together
  bool planar = false;
  bool wide_keys = false;      // 64 bits, or 32
  const void* keys = nullptr;  // of a voxel: its index within the grid's slab, from first_key on
  uint64_t first_key = 0;
  const uint32_t* triangles = nullptr;
  uint64_t count = 0;
  uint8_t* const* out = nullptr;  // of each target, in the result's layout; room for whole words
};

__device__ inline void PlaceFragment(const FragmentShading& s, uint64_t i, FragmentInput& in) {
  const uint64_t key = s.wide_keys ? static_cast<const uint64_t*>(s.keys)[i] : static_cast<const uint32_t*>(s.keys)[i];
  const uint64_t voxel = key - s.first_key;
  const auto nx = uint64_t(s.grid->dims[0]), ny = uint64_t(s.grid->dims[1]);
  const uint32_t triangle = s.triangles[i];
  const uint32_t* v = s.mesh->triangles[triangle];
  const Vec3d* p = s.mesh->index_positions;
  const TrianglePlane plane = SetUpPlane(p[v[0]], p[v[1]], p[v[2]]);
  in = MakeFragmentInput(*s.mesh, triangle, plane.degenerate, s.traits.reads_textures());
  in.voxel[0] = int64_t(voxel % nx);
  in.voxel[1] = int64_t(voxel / nx % ny);
  in.voxel[2] = int64_t(voxel / nx / ny) + s.grid->slab_begin;
  if (s.traits.needs_barycentrics) in.barycentric = Barycentrics(plane, in.voxel[0], in.voxel[1], in.voxel[2]);
}

// Whether some target keeps the fragment.
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
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8: out[at] = uint8_t(stored); break;
    case VoxelFormat::kU16:
    case VoxelFormat::kF16: reinterpret_cast<uint16_t*>(out)[at] = uint16_t(stored); break;
    default: reinterpret_cast<uint32_t*>(out)[at] = stored; break;
  }
}

// The values of all targets. All threads of a warp call it with 32 fragments from a multiple of 32 on, some of which may lie beyond the last
// one: the bits that a warp makes for a bit target are one word.
__device__ inline void WriteValues(const FragmentShading& s, uint64_t i) {
  const bool real = i < s.count;
  FragmentInput in;
  if (real) PlaceFragment(s, i, in);
  for (int t = 0; t < s.target_count; ++t) {
    const CudaTarget& target = s.targets[t];
    FragmentOutput out;
    if (real) ShadeFragment(target.shader, in, target.params, out);
    if (target.format == VoxelFormat::kBit) {
      const bool bit = real && (out.discard ? target.clear_stored != 0 : ToBit(out, target.u32_output));
      const uint32_t word = __ballot_sync(~0u, bit);
      if (threadIdx.x % 32 == 0) reinterpret_cast<uint32_t*>(s.out[t])[i / 32] = word;
      continue;
    }
    if (!real) continue;
    const auto components = uint64_t(target.components);
    for (uint64_t c = 0; c < components; ++c) {
      const uint32_t stored =
          out.discard ? target.clear_stored
                      : StoredBits(ToCell(out, target.u32_output, int(c), target.format, target.scale), target.format);
      PutElement(s.out[t], target.format, s.planar ? c * s.count + i : i * components + c, stored);
    }
  }
}

}  // namespace voxelpipe::cuda
