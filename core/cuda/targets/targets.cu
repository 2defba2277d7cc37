// Allocates, clears, packs and counts the render targets, and copies them to the host.
#include <algorithm>
#include <vector>

#include "cuda/device/launch.cuh"
#include "cuda/device/pinned.h"
#include "cuda/run/run_state.h"
#include "cuda/scatter/brick_scatter.h"
#include "cuda/targets/pack_kernels.cuh"
#include "cuda/targets/slab_copies.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/target_rules.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

// Writes `words` words of a repeated 32-bit pattern.
__global__ void __launch_bounds__(kThreads) FillWords(uint32_t* to, uint64_t words, uint32_t pattern) {
  for (uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x; i < words; i += uint64_t(gridDim.x) * kThreads) {
    to[i] = pattern;
  }
}

__global__ void __launch_bounds__(kThreads) PackKernel(const PackArgs a) {
  const uint64_t words = (a.voxels + 31) / 32;
  for (uint64_t w = uint64_t(blockIdx.x) * kThreads + threadIdx.x; w < words; w += uint64_t(gridDim.x) * kThreads) {
    a.out[w] = PackedWord(a, w);
  }
}

__global__ void __launch_bounds__(kThreads)
    CountKernel(const uint32_t* a, const uint32_t* b, uint64_t words, uint64_t* counter) {
  AddBits(a, b, words, uint64_t(blockIdx.x) * kThreads + threadIdx.x, uint64_t(gridDim.x) * kThreads, counter);
}

absl::Status ClearedBits(RunState& state, DeviceArray<uint32_t>& grid) {
  VOXELPIPE_OK_OR_RETURN(grid.Resize(state.slab_words(), state.stream));
  return grid.Fill(0, state.stream);
}

absl::Status ClearElements(RunState& state, DeviceArray<uint8_t>& array, uint32_t pattern) {
  if (pattern == 0) return array.Fill(0, state.stream);
  const uint64_t words = (array.size() + 3) / 4;  // the pool's allocations are multiples of 256 bytes
  FillWords<<<BlocksFor(words, kThreads), kThreads, 0, state.stream>>>(reinterpret_cast<uint32_t*>(array.data()), words,
                                                                       pattern);
  VOXELPIPE_LAUNCHED_OR_RETURN("FillWords");
  return absl::OkStatus();
}

absl::Status Allocate(RunState& state, CudaTarget& target, TargetMemory& memory) {
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  if (target.own_presence) {
    VOXELPIPE_OK_OR_RETURN(ClearedBits(state, memory.presence));
    target.presence = memory.presence.data();
  }
  if (target.format == VoxelFormat::kBit) {
    if (target.is_occupancy) return absl::OkStatus();
    VOXELPIPE_OK_OR_RETURN(ClearedBits(state, memory.bits));
    target.bits = memory.bits.data();
    return absl::OkStatus();
  }
  if (sparse) return absl::OkStatus();
  const int bits = BitsPerComponent(target.format);
  const uint64_t bytes = state.slab_voxels() * uint64_t(target.components) * uint64_t(bits / 8);
  VOXELPIPE_OK_OR_RETURN(memory.dense.Resize(bytes, state.stream));
  target.dense = memory.dense.data();
  return ClearElements(state, memory.dense, PatternOf(target));
}

// For smaller results the driver's staging is as fast as a pinned block.
constexpr uint64_t kMinPinned = 64 << 10;

// The buffer is in use until the stream's work is done, even after an error.
absl::Status CopyToHost(const void* from, uint64_t bytes, cudaStream_t stream, HostBuffer& to) {
  if (void* const block = bytes < kMinPinned ? nullptr : TakePinned(bytes); block != nullptr) {
    to = HostBuffer::Adopt(block, bytes, &ReturnPinned);
    VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(to.data(), from, bytes, cudaMemcpyDeviceToHost, stream));
    return absl::OkStatus();
  }
  absl::StatusOr<HostBuffer> allocated = HostBuffer::Allocate(bytes);
  if (!allocated.ok()) return allocated.status();
  to = *std::move(allocated);
  return bytes > 0 ? ReadBack(to.data(), from, bytes, stream) : absl::OkStatus();
}

// Packs the bits of a bit target.
absl::Status PackBitTarget(RunState& state, const CudaTarget& target, const TargetSpec& spec,
                           std::vector<DeviceArray<uint32_t>>& packed, std::vector<DenseSource>& sources) {
  const uint64_t bytes = (state.slab_voxels() + 7) / 8;
  const uint32_t* const coverage = state.coverage.data();
  if (target.is_occupancy && state.inside.empty() && spec.clear == 0 && state.view.dims[0] % 32 == 0) {
    sources.push_back({coverage, bytes});
    return absl::OkStatus();
  }
  DeviceArray<uint32_t>& out = packed.emplace_back();
  VOXELPIPE_OK_OR_RETURN(out.Resize((state.slab_voxels() + 31) / 32, state.stream));
  PackArgs args;
  args.present = target.own_presence ? target.presence : coverage;
  args.value = target.is_occupancy ? args.present : target.bits;
  args.inside = state.inside.empty() ? nullptr : state.inside.data();
  args.clear = spec.clear != 0 ? ~0u : 0;
  args.fill = FillBit(spec) ? ~0u : 0;
  args.nx = state.view.dims[0];
  args.words_per_row = state.view.words_per_row;
  args.voxels = state.slab_voxels();
  args.out = out.data();
  PackKernel<<<BlocksFor(out.size(), kThreads), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("PackKernel");
  sources.push_back({out.data(), bytes});
  return absl::OkStatus();
}

template <typename T>
absl::Status Take(const DeviceArray<T>& from, uint64_t count, HostBuffer& to, cudaStream_t stream) {
  return CopyToHost(from.data(), count * sizeof(T), stream, to);
}

// Copies the arrays of a sparse or bucketed result.
absl::Status CopyResult(RunState& state, ResultArrays& out) {
  DeviceResult& r = state.result;
  const bool buckets = state.request.request.result == ResultKind::kBuckets;
  if (buckets) {
    VOXELPIPE_OK_OR_RETURN(Take(r.voxels, r.listed_voxels, out.voxels, state.stream));
    VOXELPIPE_OK_OR_RETURN(Take(r.offsets, r.listed_voxels + 1, out.offsets, state.stream));
    VOXELPIPE_OK_OR_RETURN(Take(state.a_buffer.fragments.triangles[state.a_buffer.fragments.current],
                                r.listed_fragments, out.triangles, state.stream));
  } else {
    VOXELPIPE_OK_OR_RETURN(Take(r.bricks, r.listed_bricks, out.bricks, state.stream));
    VOXELPIPE_OK_OR_RETURN(Take(r.masks, r.listed_bricks * 64, out.masks, state.stream));
  }
  const uint64_t listed = buckets ? r.listed_fragments : r.listed_voxels;
  for (size_t t = 0; t < r.targets.size(); ++t) {
    out.targets.emplace_back();
    VOXELPIPE_OK_OR_RETURN(
        Take(r.targets[t], TargetBytes(state.request.request.targets[t], listed), out.targets.back(), state.stream));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status BeginSlab(RunState& state, const Slab& slab) {
  const VoxelizeRequest& request = state.request.request;
  const bool buckets = request.result == ResultKind::kBuckets;
  state.slab = slab;
  state.slab_dims = {state.view.dims[0], state.view.dims[1], slab.depth()};
  state.view.slab_begin = slab.begin;
  state.view.slab_end = slab.end;
  state.counts = SlabCounts();
  state.inside.Free();
  if (!buckets && (state.plan.path != Path::kOccupancy || request.fill != Fill::kNone)) {
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kFragments, kOddColumns, kVoxels}));
  }
  if (buckets) return absl::OkStatus();
  for (size_t i = 0; i < request.targets.size(); ++i) {
    VOXELPIPE_OK_OR_RETURN(Allocate(state, state.targets.at[i], state.target_memory[i]));
  }
  if (state.plan.path == Path::kBricks) {
    state.coverage.Free();
  } else if (state.plan.path == Path::kOccupancy) {  // the rasterizer writes all of it
    VOXELPIPE_OK_OR_RETURN(state.coverage.Resize(state.slab_words(), state.stream));
  } else {
    VOXELPIPE_OK_OR_RETURN(ClearedBits(state, state.coverage));
  }
  return absl::OkStatus();
}

void AbandonSlab(RunState& state) {
  state.target_memory = {};
  for (auto* grid : {&state.coverage, &state.inside, &state.bit_pool}) grid->Free();
  state.result = {};
  state.lists.Free();
  state.a_buffer.Free();
  state.sparse.Free();
  state.owners.Free();
  state.parts.FreeSlab();
  state.span_targets = {};  // includes the values of all triangles, which are recomputed
  state.scratch.Free();
  if (cudaStreamSynchronize(state.stream) != cudaSuccess) (void)cudaGetLastError();  // the next call returns the error
  // Kernels work without it.
  state.scattered_mesh.Drop();
  TrimMemory(state.device.ordinal);
}

absl::Status CountBits(RunState& state, const uint32_t* a, const uint32_t* b, uint64_t words, Counter counter) {
  CountKernel<<<BlocksFor(words, kThreads, 1 << 12), kThreads, 0, state.stream>>>(a, b, words,
                                                                                  state.counters.data() + counter);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountKernel");
  return absl::OkStatus();
}

absl::Status CountSlab(RunState& state) {
  if (state.request.request.result != ResultKind::kBuckets && state.plan.path != Path::kBricks) {
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kVoxels}));
    return CountBits(state, state.coverage.data(), state.inside.empty() ? nullptr : state.inside.data(),
                     state.slab_words(), kVoxels);
  }
  return absl::OkStatus();
}

absl::Status PackDense(RunState& state, std::vector<DeviceArray<uint32_t>>& packed, std::vector<DenseSource>& sources) {
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (target.format == VoxelFormat::kBit) {
      VOXELPIPE_OK_OR_RETURN(PackBitTarget(state, target, state.request.request.targets[size_t(i)], packed, sources));
      continue;
    }
    const DeviceArray<uint8_t>& dense = state.target_memory[size_t(i)].dense;
    sources.push_back({dense.data(), dense.size()});
  }
  return absl::OkStatus();
}

absl::Status CopyDense(const std::vector<DenseSource>& sources, cudaStream_t stream, ResultArrays& out) {
  for (const DenseSource& source : sources) {
    out.targets.emplace_back();
    VOXELPIPE_OK_OR_RETURN(CopyToHost(source.from, source.bytes, stream, out.targets.back()));
  }
  return absl::OkStatus();
}

namespace {

// Host bytes of the lists of a sparse or bucketed result.
uint64_t ListedBytes(const RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  const DeviceResult& lists = state.result;
  const bool buckets = request.result == ResultKind::kBuckets;
  const uint64_t values = buckets ? lists.listed_fragments : lists.listed_voxels;
  uint64_t bytes = buckets ? 8 * (2 * lists.listed_voxels + 1) + 4 * values : (8 + 64) * lists.listed_bricks;
  for (const TargetSpec& target : request.targets) bytes += TargetBytes(target, values);
  return bytes;
}

}  // namespace

absl::StatusOr<ResultArrays> Finish(RunState& state) {
  const ResultKind kind = state.request.request.result;
  if (kind == ResultKind::kSparse) VOXELPIPE_OK_OR_RETURN(MakeBricks(state));
  if (kind != ResultKind::kDense) VOXELPIPE_OK_OR_RETURN(state.memory.TakeOnHost(ListedBytes(state)));
  ResultArrays out;
  std::vector<DeviceArray<uint32_t>> packed;
  const auto copy_dense = [&]() -> absl::Status {
    std::vector<DenseSource> sources;
    VOXELPIPE_OK_OR_RETURN(PackDense(state, packed, sources));
    return CopyDense(sources, state.stream, out);
  };
  const absl::Status status = kind == ResultKind::kDense ? copy_dense() : CopyResult(state, out);
  // Also after an error: buffers return to their pools only when no copy into them is in progress.
  const cudaError_t error = cudaStreamSynchronize(state.stream);
  if (!status.ok()) return status;
  VOXELPIPE_CUDA_OR_RETURN(error);
  return out;
}

}  // namespace voxelpipe::cuda
