// The fine raster of a target whose value is the same for all fragments of a triangle: the value is made once a triangle, and a row
// of voxels costs little more than its atomics. No host-only includes.
#pragma once

#include "cuda/fine_raster_kernel.cuh"
#include "cuda/uniform_value.cuh"
#include "cuda/walk_kernels.cuh"

namespace voxelpipe::cuda {

inline constexpr int kMostUniformThreads = 256, kUniformSetups = 4;  // set-ups a warp
// Bytes of shared memory behind the target's, for each warp.
inline constexpr int kUniformWarpBytes = kUniformSetups * int(sizeof(SharedSetup) + 32);

__device__ inline void BlendUniform(const TileTarget& t, uint32_t* shared, int row, uint32_t mask,
                                    const UniformValue& value) {
  const int components = t.target.components;
  switch (t.kept) {
    case Kept::kBitOr:
      if (value.component[0] != 0) atomicOr(shared + t.bits + row, mask);
      return;
    case Kept::kBitAnd:
      if (value.component[0] == 0) atomicAnd(shared + t.bits + row, ~mask);
      return;
    default: break;
  }
  for (uint32_t left = mask; left != 0; left &= left - 1) {
    const int voxel = row * 32 + __ffs(int(left)) - 1;
    switch (t.kept) {
      case Kept::kCount: atomicAdd(shared + t.counts + voxel, 1u); break;
      case Kept::kAverage: atomicAdd(shared + t.counts + voxel, 1u); [[fallthrough]];
      case Kept::kSum: {
        auto* const sums = reinterpret_cast<unsigned long long*>(shared + t.sums) + voxel * components;
#pragma unroll
        for (int c = 0; c < 4; ++c) {
          if (c < components) atomicAdd(sums + c, static_cast<unsigned long long>(value.component[c]));
        }
        break;
      }
      default: {
        uint32_t* const cells = shared + t.cells + voxel * components;
#pragma unroll
        for (int c = 0; c < 4; ++c) {
          if (c >= components) break;
          const auto v = uint32_t(value.component[c]);
          if (t.kept == Kept::kMax) {
            atomicMax(cells + c, v);
          } else if (t.kept == Kept::kMin) {
            atomicMin(cells + c, v);
          } else if (t.kept == Kept::kOr) {
            atomicOr(cells + c, v);
          } else {
            atomicAnd(cells + c, v);
          }
        }
      }
    }
  }
}

// As FineRasterKernel, for a launch of one target. Any block size up to kMostUniformThreads: large blocks for tiles with many triangles,
// small ones where many tiles have few.
__global__ void __launch_bounds__(kMostUniformThreads, 2) FineUniformKernel(const __grid_constant__ FineArgs args) {
  extern __shared__ uint64_t shared_memory[];
  auto* const shared = reinterpret_cast<uint32_t*>(shared_memory);
  __shared__ uint32_t touched[kTileRows], queue[kMostUniformThreads], queued;
  __shared__ uint64_t number;
  const int threads = int(blockDim.x), thread = int(threadIdx.x), lane = thread % 32, warp = thread / 32;
  auto* const setups = reinterpret_cast<SharedSetup*>(shared + args.shared_words) + warp * kUniformSetups;
  auto* const values = reinterpret_cast<UniformValue*>(reinterpret_cast<SharedSetup*>(shared + args.shared_words) +
                                                       threads / 32 * kUniformSetups) +
                       warp * kUniformSetups;
  const TileTarget& target = args.targets[0];
  const uint64_t count = *args.occupied_count + (args.parts.list == nullptr ? 0 : *args.parts.count);
  uint64_t fragments = 0;
  for (;;) {
    __syncthreads();
    if (thread == 0) number = atomicAdd(reinterpret_cast<unsigned long long*>(args.next_tile), 1ull);
    __syncthreads();
    if (number >= count) break;
    TileWork work;
    if (!TakeWork(args, number, work)) continue;
    const VoxelRange range = TileVoxels(args.grid.tiles, args.first_tile + work.tile, args.grid.dims);
    const Box32 box_of_tile{{int(range.begin[0]), int(range.begin[1]), int(range.begin[2])},
                            {int(range.end[0]), int(range.end[1]), int(range.end[2])}};
    const auto blend = [&](const UniformValue& value, int y, int z, int x_begin, int x_end) {
      const int row = (y - box_of_tile.begin[1]) + 8 * (z - box_of_tile.begin[2]);
      const uint32_t mask = RowMask(x_begin - box_of_tile.begin[0], x_end - box_of_tile.begin[0]);
      OrIfMissing(touched + row, mask);
      fragments += unsigned(__popc(mask));
      BlendUniform(target, shared, row, mask, value);
    };
    for (int row = thread; row < kTileRows; row += threads) touched[row] = 0;
    if (thread == 0) queued = 0;
    BeginTile(target, shared, thread, threads);
    __syncthreads();
    for (uint32_t first = work.begin; first < work.end; first += uint32_t(threads)) {
      const uint32_t i = first + threadIdx.x;
      if (i < work.end) {
        const uint32_t t = args.pair_triangles[i];
        const Corners corners = LoadCorners(&args.mesh->triangles[0][0], t);
        const CodedBox box = LoadBox(args.codes, corners);
        Box32 clipped;
        UniformValue value;
        ShadeUniform(args, t, value);
        bool wait = box.far;
        if (!box.far && Clip(box, box_of_tile, clipped)) {
          const bool run = IsRun(box, args.coverage);
          SpanBounds<float> bounds;
          wait = clipped.rows() > kRowsOfThread || args.coverage == Coverage::kCenter ||
                 (!run && !SetUpNarrow(args.mesh->index_positions, args.coverage, corners, box, bounds));
          if (!wait) {
            if (run) {
              for (int z = clipped.begin[2]; z < clipped.end[2]; ++z) {
                for (int y = clipped.begin[1]; y < clipped.end[1]; ++y)
                  blend(value, y, z, clipped.begin[0], clipped.end[0]);
              }
            } else {
              WalkNarrow(bounds, box.base, clipped,
                         [&](int y, int z, int x_begin, int x_end) { blend(value, y, z, x_begin, x_end); });
            }
          }
        }
        if (wait) queue[atomicAdd(&queued, 1u)] = t;
      }
      __syncthreads();
      // What is too large for a thread: a warp sets up a few at a time and shares their rows.
      const uint32_t waiting = queued;
      for (uint32_t q = uint32_t(warp * kUniformSetups); q < waiting; q += uint32_t(threads / 32 * kUniformSetups)) {
        uint32_t rows = 0;
        if (lane < kUniformSetups && q + uint32_t(lane) < waiting) {
          rows = uint32_t(SetUpShared(args.mesh->index_positions, &args.mesh->triangles[0][0], args.coverage, range,
                                      queue[q + uint32_t(lane)], setups[lane]));
          if (rows > 0) ShadeUniform(args, queue[q + uint32_t(lane)], values[lane]);
        }
        __syncwarp();
        for (int s = 0; s < kUniformSetups; ++s) {
          const uint32_t rows_here = __shfl_sync(~0u, rows, s);
          for (uint32_t row = uint32_t(lane); row < rows_here; row += 32) {
            int y, z, x_begin, x_end;
            if (SharedRowSpan(setups[s], row, y, z, x_begin, x_end)) blend(values[s], y, z, x_begin, x_end);
          }
        }
        __syncwarp();
      }
      __syncthreads();
      if (thread == 0) queued = 0;
      __syncthreads();
    }
    if (work.parts > 1 && !JoinParts(args, work, shared, touched, touched)) continue;
    StoreTile(args, shared, range, touched, touched, work.slot);
  }
  if (args.fragments == nullptr) return;
  for (int step = 16; step > 0; step /= 2) fragments += __shfl_down_sync(~0u, fragments, step);
  if (lane == 0 && fragments > 0) atomicAdd(reinterpret_cast<unsigned long long*>(args.fragments), fragments);
}

}  // namespace voxelpipe::cuda
