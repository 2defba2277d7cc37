// Sorting of (tile, triangle) pairs, and the runs of equal tiles.
#include <tbb/parallel_sort.h>

#include "cpu/parallel.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {

absl::Status TileSort(RunState& state) {
  if (state.row_bits) return absl::OkStatus();
  std::vector<uint64_t>& pairs = state.pairs;
  tbb::parallel_sort(pairs.begin(), pairs.end());
  for (uint64_t begin = 0; begin < pairs.size();) {
    const uint64_t tile = pairs[begin] >> 32;
    uint64_t end = begin + 1;
    while (end < pairs.size() && pairs[end] >> 32 == tile) ++end;
    state.runs.push_back({begin, end});
    begin = end;
  }
  return state.job.Check();
}

}  // namespace voxelpipe::cpu
