// The kernel that ranks covered voxels, and the allocation of accumulators.
#include "cuda/coverage/accumulators.h"

#include "cuda/coverage/set_bits.cuh"

namespace voxelpipe::cuda {
namespace {

inline constexpr int kRankedOfThread = 16;  // words per thread

// Assigns consecutive ranks to all set bits of a bit grid; `counter` receives their number.
__global__ void __launch_bounds__(kBlendThreads)
    RankWords(const uint32_t* bits, uint64_t words, uint32_t* first, uint64_t* counter) {
  constexpr int kEach = kRankedOfThread;
  __shared__ unsigned long long room[kBlendThreads / 32 + 1];
  const uint64_t begin = uint64_t(blockIdx.x) * (kBlendThreads * kEach) + threadIdx.x * 4;
  uint32_t word[kEach];
  uint32_t count = 0;
#pragma unroll
  for (int i = 0; i < kEach; i += 4) {
    const uint64_t at = begin + uint64_t(i) * kBlendThreads;
    const uint4 four = FourWords(bits, at, words);
    word[i] = four.x, word[i + 1] = four.y, word[i + 2] = four.z, word[i + 3] = four.w;
#pragma unroll
    for (int k = 0; k < 4; ++k) count += uint32_t(__popc(word[i + k]));
  }
  auto rank = uint32_t(BlockAllocate<kBlendThreads>(counter, count, room));
#pragma unroll
  for (int i = 0; i < kEach; ++i) {
    if (word[i] == 0) continue;
    first[begin + uint64_t(i / 4) * (4 * kBlendThreads) + uint64_t(i % 4)] = rank;
    rank += uint32_t(__popc(word[i]));
  }
}

}  // namespace

Ranks RanksOf(RunState& state) {
  Ranks ranks;
  ranks.bits = TouchedBits(state);
  ranks.first = state.lists.word_ranks.data();
  return ranks;
}

Accumulators AccumulatorsOf(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  Accumulators to = ShapeOf(target);
  to.cells = memory.cells.data();
  to.sums = memory.sums.data();
  to.counts = memory.counts.data();
  return to;
}

absl::Status RankCovered(RunState& state) {
  const uint64_t words = state.slab_words();
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kRanks}));
  VOXELPIPE_OK_OR_RETURN(state.lists.word_ranks.Resize(words, state.stream));
  RankWords<<<BlocksFor(words, kBlendThreads * kRankedOfThread, UINT32_MAX), kBlendThreads, 0, state.stream>>>(
      TouchedBits(state), words, state.lists.word_ranks.data(), state.counters.data() + kRanks);
  VOXELPIPE_LAUNCHED_OR_RETURN("RankWords");
  return absl::OkStatus();
}

absl::Status BeginAccumulators(RunState& state, int index, uint64_t voxels) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  const Accumulators shape = ShapeOf(target);
  const Kept kept = shape.kept;
  const uint64_t cells = voxels * uint64_t(shape.components);
  if (kept == Kept::kCount || kept == Kept::kAverage) {
    VOXELPIPE_OK_OR_RETURN(memory.counts.Resize(voxels, state.stream));
    VOXELPIPE_OK_OR_RETURN(memory.counts.Fill(0, state.stream));
    if (kept == Kept::kCount) return absl::OkStatus();
  }
  if (IsSum(kept)) {
    VOXELPIPE_OK_OR_RETURN(memory.sums.Resize(cells, state.stream));
    return memory.sums.Fill(0, state.stream);
  }
  VOXELPIPE_OK_OR_RETURN(memory.cells.Resize(cells, state.stream));
  return memory.cells.Fill(BeginsWithOnes(kept) ? 0xff : 0, state.stream);
}

}  // namespace voxelpipe::cuda
