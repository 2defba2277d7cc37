// The kernel of the fine raster. No host-only includes: NVRTC compiles it too.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, section 3.3 (fine raster in shared memory). Changed: tiles come from a
// counter that persistent blocks share; coverage is taken as row spans; blends are order-independent atomics.
#pragma once

#include "cuda/primitives/atomics.cuh"
#include "cuda/primitives/blend_rules.cuh"
#include "cuda/primitives/shading_args.h"
#include "cuda/primitives/voxel_code.h"
#include "cuda/tiles/split_tiles.cuh"
#include "cuda/traversal/row_traversal.cuh"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cuda {

// One triangle's fragments: what they share is made once.
class TileShader {
 public:
  __device__ TileShader(const FineArgs& args, uint32_t triangle) {
    const uint32_t* v = args.mesh->triangles[triangle];
    const Vec3d* p = args.mesh->index_positions;
    plane_ = SetUpPlane(p[v[0]], p[v[1]], p[v[2]]);
    in_ = MakeFragmentInput(*args.mesh, triangle, plane_.degenerate, args.traits.reads_textures());
  }

  // Blends the fragments of one row of the tile that begins at (x0, y0, z0). `pass` 0 blends and finds owners, 1 writes
  // the owners' values. Returns the voxels that some target of the launch kept.
  __device__ uint32_t Row(const FineArgs& args, uint32_t* shared, int pass, int row, uint32_t mask,
                          const int64_t (&begin)[3]) {
    uint32_t kept = 0;
    for (uint32_t left = mask; left != 0; left &= left - 1) {
      const int x = __ffs(int(left)) - 1;
      in_.voxel[0] = begin[0] + x;
      in_.voxel[1] = begin[1] + row % 8;
      in_.voxel[2] = begin[2] + row / 8;
      bool placed = false;
      for (int t = 0; t < args.target_count; ++t) {
        const TileTarget& target = args.targets[t];
        if (target.kept == Kept::kNothing) continue;
        const bool owner = target.has_owner();
        if (pass == 1 && !owner) continue;
        const uint32_t key = OwnerKey(target.target.blend, in_.triangle);
        uint32_t* const winner = shared + target.owner + row * 32 + x;
        if (pass == 1 && *winner != key) continue;
        if (pass == 0 && owner && !target.target.own_presence) {
          atomicMax(winner, key);
          continue;
        }
        if (args.traits.needs_barycentrics && !placed) {
          in_.barycentric = Barycentrics(plane_, in_.voxel[0], in_.voxel[1], in_.voxel[2]);
          placed = true;
        }
        FragmentOutput out;
        ShadeFragment(target.target.shader, in_, target.target.params, out);
        if (out.discard) continue;
        kept |= 1u << x;
        if (!owner) {
          BlendFragment(target, shared, row, x, out);
        } else if (pass == 0) {
          atomicOr(shared + target.presence + row, 1u << x);
          atomicMax(winner, key);
        } else {
          WriteOwner(target, shared, row, x, out);
        }
      }
    }
    return kept;
  }

 private:
  TrianglePlane plane_;
  FragmentInput in_;
};

// Bits begin <= x < end of a tile's row, begin < end.
__device__ inline uint32_t RowMask(int begin, int end) {
  return (~0u << begin) & (~0u >> (32 - end));
}

template <typename Element>
__device__ inline void StoreElements(const FineArgs& args, const TileTarget& t, const uint32_t* shared,
                                     const VoxelRange& range, const uint32_t* present, uint64_t slot) {
  const auto components = uint64_t(t.target.components);
  auto* const values =
      args.tile_values == nullptr
          ? nullptr
          : reinterpret_cast<Element*>(args.tile_values + slot * args.value_stride + args.value_offset[t.index]);
  auto* const dense = reinterpret_cast<Element*>(t.target.dense);
  for (int voxel = int(threadIdx.x); voxel < kTileVoxels; voxel += int(blockDim.x)) {
    const int row = voxel / 32, x = voxel % 32;
    if ((present[row] >> x & 1) == 0) continue;
    const uint64_t n =
        uint64_t(range.begin[0] + x) +
        uint64_t(args.grid.dims[0]) * uint64_t((range.begin[1] + row % 8) +
                                               args.grid.dims[1] * (range.begin[2] + row / 8 - args.grid.slab_begin));
    for (uint64_t c = 0; c < components; ++c) {
      const auto stored = Element(StoredAt(t, shared, voxel, int(c)));
      if (values != nullptr) {
        values[uint64_t(voxel) * components + c] = stored;
      } else {
        dense[args.planar ? c * args.slab_voxels + n : n * components + c] = stored;
      }
    }
  }
}

// Words of the tile's rows to a bit grid. All rows of the tile are the block's own.
__device__ inline void StoreWords(const FineArgs& args, const VoxelRange& range, const uint32_t* words, uint32_t* grid,
                                  bool add) {
  for (int row = int(threadIdx.x); row < kTileRows; row += int(blockDim.x)) {
    const int64_t y = range.begin[1] + row % 8, z = range.begin[2] + row / 8;
    if (y >= range.end[1] || z >= range.end[2]) continue;
    uint32_t* const word = grid + args.grid.Word(range.begin[0], y, z);
    *word = add ? *word | words[row] : words[row];
  }
}

__device__ inline void StoreTile(const FineArgs& args, const uint32_t* shared, const VoxelRange& range,
                                 const uint32_t* touched, const uint32_t* covered, uint64_t slot) {
  StoreWords(args, range, args.any_always_present ? touched : covered, args.coverage_bits, true);
  for (int i = 0; i < args.target_count; ++i) {
    const TileTarget& t = args.targets[i];
    const uint32_t* const present = t.target.own_presence ? shared + t.presence : touched;
    if (t.target.own_presence) StoreWords(args, range, present, t.target.presence, false);
    if (t.kept == Kept::kNothing) continue;
    if (t.target.format == VoxelFormat::kBit) {
      StoreWords(args, range, shared + t.bits, t.target.bits, false);
      continue;
    }
    switch (t.target.format) {
      case VoxelFormat::kU8Srgb:
      case VoxelFormat::kU8: StoreElements<uint8_t>(args, t, shared, range, present, slot); break;
      case VoxelFormat::kU16:
      case VoxelFormat::kF16: StoreElements<uint16_t>(args, t, shared, range, present, slot); break;
      default: StoreElements<uint32_t>(args, t, shared, range, present, slot); break;
    }
  }
}

// Blends the triangles of a tile's pairs [begin, end) once: pass 0 and, where replace or first have owners, pass 1. All
// threads of the block.
template <bool kShades>
__device__ inline void RasterTile(const FineArgs& args, const uint32_t* triangles, uint32_t* shared, int pass,
                                  const VoxelRange& range, uint32_t begin, uint32_t end, uint32_t* touched,
                                  uint32_t* covered, uint32_t* queue, uint32_t* queued, uint64_t& fragments) {
  constexpr uint32_t kRowsOfThread = 12;
  const int64_t origin[3] = {range.begin[0], range.begin[1], range.begin[2]};
  const Vec3d* const positions = args.mesh->index_positions;
  const auto set_up = [&](uint32_t triangle) {
    const uint32_t* v = args.mesh->triangles[triangle];
    return SetUpTriangle(positions[v[0]], positions[v[1]], positions[v[2]], args.coverage);
  };
  const auto blend = [&](TileShader* shader, int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
    const int row = int(y - origin[1]) + 8 * int(z - origin[2]);
    const uint32_t mask = RowMask(int(x_begin - origin[0]), int(x_end - origin[0]));
    if (pass == 0) {
      OrIfMissing(touched + row, mask);
      fragments += unsigned(__popc(mask));
    }
    if constexpr (kShades) {
      const uint32_t kept = shader->Row(args, shared, pass, row, mask, origin);
      if (pass == 0 && !args.any_always_present && kept != 0) atomicOr(covered + row, kept);
    }
  };
  for (uint32_t first = begin; first < end; first += kFineThreads) {
    const uint32_t i = first + threadIdx.x;
    if (i < end) {
      const uint32_t triangle = triangles[i];
      const TriangleSetup s = set_up(triangle);
      const VoxelRange clipped = ClipToRange(s, range);
      if (!clipped.empty()) {
        if (!IsForOneThread(s, clipped, kRowsOfThread)) {
          queue[atomicAdd(queued, 1u)] = triangle;
        } else if constexpr (kShades) {
          TileShader shader(args, triangle);
          WalkRows(s, clipped, [&](int y, int z, int x_begin, int x_end) { blend(&shader, y, z, x_begin, x_end); });
        } else {
          WalkRows(s, clipped, [&](int y, int z, int x_begin, int x_end) { blend(nullptr, y, z, x_begin, x_end); });
        }
      }
    }
    __syncthreads();
    const uint32_t count = *queued;
    for (uint32_t q = threadIdx.x / 32; q < count; q += kFineThreads / 32) {
      const TriangleSetup s = set_up(queue[q]);
      const VoxelRange clipped = ClipToRange(s, range);
      const uint32_t rows = RowCount(clipped);
      const auto deal_rows = [&](TileShader* shader) {
        for (uint32_t row = threadIdx.x % 32; row < rows; row += 32) {
          int64_t y, z, x_begin, x_end;
          if (RowSpan(s, clipped, row, y, z, x_begin, x_end)) blend(shader, y, z, x_begin, x_end);
        }
      };
      if constexpr (kShades) {
        TileShader shader(args, queue[q]);
        deal_rows(&shader);
      } else {
        deal_rows(nullptr);
      }
    }
    __syncthreads();
    if (threadIdx.x == 0) *queued = 0;
    __syncthreads();
  }
}

// Adds what the threads of a warp counted. All of them call it.
__device__ inline void AddFragments(uint64_t fragments, uint64_t* to) {
  for (int step = 16; step > 0; step /= 2) fragments += __shfl_down_sync(~0u, fragments, step);
  if (threadIdx.x % 32 == 0 && fragments > 0) atomicAdd(reinterpret_cast<unsigned long long*>(to), fragments);
}

// Persistent blocks; `shared` has the room that PlaceTileTarget gave out.
template <bool kShades>
__global__ void __launch_bounds__(kFineThreads, 2) FineRasterKernel(const __grid_constant__ FineArgs args) {
  extern __shared__ uint64_t shared_memory[];
  auto* const shared = reinterpret_cast<uint32_t*>(shared_memory);
  __shared__ uint32_t touched[kTileRows], covered[kTileRows], queue[kFineThreads], queued;
  __shared__ uint64_t number;
  const auto thread = int(threadIdx.x);
  const uint64_t count = *args.occupied_count + (args.parts.list == nullptr ? 0 : *args.parts.count);
  uint64_t fragments = 0;
  if (thread == 0) queued = 0;
  for (;;) {
    __syncthreads();
    if (thread == 0) number = atomicAdd(reinterpret_cast<unsigned long long*>(args.next_tile), 1ull);
    __syncthreads();
    if (number >= count) break;
    TileWork work;
    if (!TakeWork(args, number, work)) continue;
    const VoxelRange whole = TileVoxels(args.grid.tiles, args.first_tile + work.tile, args.grid.dims);
    if (thread < kTileRows) touched[thread] = covered[thread] = 0;
    for (int t = 0; t < args.target_count; ++t) BeginTile(args.targets[t], shared, thread, kFineThreads);
    __syncthreads();
    for (int pass = 0; pass < (args.has_owners ? 2 : 1); ++pass) {
      RasterTile<kShades>(args, args.pair_triangles, shared, pass, whole, work.begin, work.end, touched, covered, queue,
                          &queued, fragments);
    }
    if (work.parts > 1 && !JoinParts(args, work, shared, touched, covered)) continue;
    StoreTile(args, shared, whole, touched, covered, work.slot);
  }
  if (args.fragments != nullptr) AddFragments(fragments, args.fragments);
}

}  // namespace voxelpipe::cuda
