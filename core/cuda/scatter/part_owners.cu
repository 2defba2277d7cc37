// Owners of voxels where parts are filled: the part of the highest rank among those with a fragment in a voxel and
// those that contain its centre.
#include "cuda/scatter/part_owners.h"

#include "cuda/coverage/accumulators.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/part_order.h"

namespace voxelpipe::cuda {
namespace {

struct OwnerArgs {
  PartRuns parts;
  Ranks ranks;                      // of touched voxels
  const uint32_t* cells = nullptr;  // of these the largest number of a triangle plus 1; null: nothing is touched
  const uint32_t* inside = nullptr;
  const uint16_t* inside_ranks = nullptr;
  uint64_t words = 0;
  uint32_t nx = 0, words_per_row = 0;

  // The rank plus 1 of the part whose fragment in a touched voxel has the largest number.
  __device__ uint32_t RankAt(uint32_t word, uint32_t x) const { return parts.Of(cells[ranks.Of(word, x)] - 1).rank; }
};

// One thread per word of a target's presence.
__global__ void __launch_bounds__(kBlendThreads) DropBelow(const __grid_constant__ OwnerArgs args, uint32_t* present) {
  const uint64_t step = uint64_t(gridDim.x) * kBlendThreads;
  for (uint64_t word = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x; word < args.words; word += step) {
    const uint32_t here = present[word] & args.inside[word];  // elsewhere fragments own
    uint32_t dropped = 0;
    for (uint32_t left = here; left != 0; left &= left - 1) {
      const uint32_t x = uint32_t(__ffs(int(left))) - 1;
      const uint64_t voxel = VoxelOfBit(uint32_t(word) * 32 + x, args.nx, args.words_per_row);
      if (args.inside_ranks[voxel] > args.RankAt(uint32_t(word), x)) dropped |= 1u << x;
    }
    if (dropped != 0) present[word] &= ~dropped;
  }
}

// Adds up the voxels of one part after the other: neighbours mostly have the same. All lanes call each function.
class OwnedCount {
 public:
  __device__ explicit OwnedCount(unsigned long long* counts) : counts_(counts) {}
  __device__ void Add(uint32_t rank, uint32_t voxels) {
    if (rank != rank_) Flush();
    rank_ = rank;
    voxels_ += voxels;
  }
  __device__ void Flush() {
    if (voxels_ > 0 && threadIdx.x % 32 == 0) atomicAdd(counts_ + rank_, static_cast<unsigned long long>(voxels_));
    voxels_ = 0;
  }

 private:
  unsigned long long* const counts_;
  uint32_t rank_ = 0, voxels_ = 0;
};

// A warp takes 32 words at a time, one after the other, a lane a voxel. `counts`: by rank.
__global__ void __launch_bounds__(kBlendThreads)
    CountOwners(const __grid_constant__ OwnerArgs args, unsigned long long* counts) {
  const uint32_t lane = threadIdx.x % 32;
  const uint64_t warps = uint64_t(gridDim.x) * (kBlendThreads / 32);
  OwnedCount owned(counts);
  for (uint64_t first = (uint64_t(blockIdx.x) * (kBlendThreads / 32) + threadIdx.x / 32) * 32; first < args.words;
       first += warps * 32) {
    const bool in_grid = first + lane < args.words;
    const uint32_t my_inside = in_grid ? args.inside[first + lane] : 0;
    const uint32_t my_touched = in_grid && args.cells != nullptr ? args.ranks.bits[first + lane] : 0;
    for (uint32_t some = __ballot_sync(~0u, (my_inside | my_touched) != 0); some != 0; some &= some - 1) {
      const int k = __ffs(int(some)) - 1;
      const uint32_t word = uint32_t(first) + uint32_t(k);
      uint32_t rank = 0;  // plus 1
      if ((__shfl_sync(~0u, my_inside, k) >> lane & 1) != 0) {
        rank = args.inside_ranks[VoxelOfBit(word * 32 + lane, args.nx, args.words_per_row)];
      }
      if ((__shfl_sync(~0u, my_touched, k) >> lane & 1) != 0) rank = max(rank, args.RankAt(word, lane));
      for (uint32_t left = __ballot_sync(~0u, rank != 0); left != 0;) {
        const uint32_t of = __shfl_sync(~0u, rank, __ffs(int(left)) - 1);
        const uint32_t same = __ballot_sync(~0u, rank == of);
        owned.Add(of - 1, uint32_t(__popc(same)));
        left &= ~same;
      }
    }
  }
  owned.Flush();
}

__global__ void __launch_bounds__(kBlendThreads) OwnerIds(PartRuns parts, uint64_t triangles, uint32_t* keys) {
  const uint64_t t = uint64_t(blockIdx.x) * kBlendThreads + threadIdx.x;
  if (t < triangles) keys[t] = OwnerOf(uint32_t(t) + parts.Of(t).id_offset);
}

PartRuns RunsOf(const RunState& state) {
  return {state.mesh.host_view.parts, state.mesh.host_view.part_count};
}

OwnerArgs ArgsFor(RunState& state, const uint32_t* cells) {
  OwnerArgs args;
  args.parts = RunsOf(state);
  args.ranks = RanksOf(state);
  args.cells = cells;
  args.inside = state.inside.data();
  args.inside_ranks = state.parts.inside_ranks.data();
  args.words = state.slab_words();
  args.nx = uint32_t(state.view.dims[0]);
  args.words_per_row = uint32_t(state.view.words_per_row);
  return args;
}

}  // namespace

int TargetOfOwners(const RunState& state) {
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (target.of_owner && state.plan.targets[size_t(i)].source == ValueSource::kOwners) return i;
  }
  return -1;
}

absl::Status BeginOwners(RunState& state, uint64_t voxels) {
  VOXELPIPE_OK_OR_RETURN(state.parts.owners.Resize(voxels, state.stream));
  return state.parts.owners.Fill(0, state.stream);
}

AccumulateArgs OwnersOf(RunState& state) {
  AccumulateArgs args;
  args.shading.mesh = state.mesh.view.data();
  args.shading.kept = Kept::kOwner;
  args.ranks = RanksOf(state);
  args.to.kept = Kept::kMax;
  args.to.cells = state.parts.owners.data();
  return args;
}

absl::Status ListOwnerIds(RunState& state, uint32_t* keys) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  OwnerIds<<<unsigned((triangles + kBlendThreads - 1) / kBlendThreads), kBlendThreads, 0, state.stream>>>(
      RunsOf(state), triangles, keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("OwnerIds");
  return absl::OkStatus();
}

absl::Status KeepOwners(RunState& state) {
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (!target.of_owner) continue;
    if (!target.may_discard) {
      VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(target.presence, state.coverage.data(),
                                               state.slab_words() * sizeof(uint32_t), cudaMemcpyDeviceToDevice,
                                               state.stream));
    }
    const OwnerArgs args = ArgsFor(state, state.span_targets[size_t(i)].cells.data());
    DropBelow<<<BlocksFor(args.words, kBlendThreads), kBlendThreads, 0, state.stream>>>(args, target.presence);
    VOXELPIPE_LAUNCHED_OR_RETURN("DropBelow");
  }
  return absl::OkStatus();
}

absl::Status CountOwned(RunState& state) {
  if (state.mesh.host_view.triangle_count == 0) return absl::OkStatus();
  const uint32_t* cells = nullptr;
  if (state.plan.path != Path::kNothing) {
    const int of_target = TargetOfOwners(state);
    cells = of_target >= 0 ? state.span_targets[size_t(of_target)].cells.data() : state.parts.owners.data();
  }
  const OwnerArgs args = ArgsFor(state, cells);
  auto* const counts = reinterpret_cast<unsigned long long*>(state.parts.counts.data() + state.parts.count);
  CountOwners<<<BlocksFor(args.words, kBlendThreads), kBlendThreads, 0, state.stream>>>(args, counts);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountOwners");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
