// Sorts (tile, triangle) pairs and finds the runs of equal tiles: a stable radix sort by tile, so that triangles keep
// the order of emission. The high bits of the tile first, from memory to memory; the rest bucket by bucket, in the
// caches.
#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <bit>

#include "base/parallel.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {
namespace {

constexpr uint64_t kMaxBuckets = 1 << 10;
// A bucket of fewer pairs than this share of its tiles is sorted by comparison.
constexpr uint64_t kTilesPerPair = 8;

// Sorts the pairs of a bucket by tile. Not thread-safe.
class BucketSort {
 public:
  // In: pairs of tiles [first_tile, first_tile + tiles). Out: sorted, stable.
  void Sort(uint64_t* pairs, uint64_t count, uint64_t first_tile, uint64_t tiles) {
    if (tiles > kTilesPerPair * count) return std::sort(pairs, pairs + count);  // by triangle within a tile
    held_.assign(pairs, pairs + count);
    next_.assign(tiles + 1, 0);
    for (const uint64_t pair : held_) ++next_[(pair >> 32) - first_tile + 1];
    for (uint64_t tile = 0; tile < tiles; ++tile) next_[tile + 1] += next_[tile];
    for (const uint64_t pair : held_) pairs[next_[(pair >> 32) - first_tile]++] = pair;
  }

 private:
  std::vector<uint64_t> held_, next_;
};

// offset[chunk][bucket]: the destination of the chunk's pairs of the bucket. Its last row holds the ends of the
// buckets.
std::vector<uint64_t> BucketOffsets(const std::vector<PairBlocks>& emitted, uint64_t buckets, int shift) {
  const size_t chunks = emitted.size();
  std::vector<uint64_t> offset((chunks + 1) * buckets);
  tbb::parallel_for(size_t{0}, chunks, [&](size_t chunk) {
    uint64_t* const count = &offset[chunk * buckets];
    emitted[chunk].ForEach([&](uint64_t pair) { ++count[pair >> 32 >> shift]; });
  });
  uint64_t total = 0;
  for (uint64_t bucket = 0; bucket < buckets; ++bucket) {
    for (size_t chunk = 0; chunk < chunks; ++chunk) {
      const uint64_t here = offset[chunk * buckets + bucket];
      offset[chunk * buckets + bucket] = total;
      total += here;
    }
    offset[chunks * buckets + bucket] = total;
  }
  return offset;
}

void AppendRuns(const uint64_t* pairs, uint64_t begin, uint64_t end, std::vector<TileRun>& runs) {
  while (begin < end) {
    const uint64_t tile = pairs[begin] >> 32;
    uint64_t last = begin + 1;
    while (last < end && pairs[last] >> 32 == tile) ++last;
    runs.push_back({begin, last});
    begin = last;
  }
}

}  // namespace

absl::Status TileSort(RunState& state) {
  if (state.row_bits) return absl::OkStatus();
  const uint64_t tiles = state.tiles.count();
  int shift = 0;
  while (tiles >> shift > kMaxBuckets) ++shift;
  const uint64_t buckets = (tiles >> shift) + 1;
  const size_t chunks = state.emitted.size();
  std::vector<uint64_t> offset = BucketOffsets(state.emitted, buckets, shift);
  const uint64_t* const ends = &offset[chunks * buckets];
  const uint64_t pair_bytes = ends[buckets - 1] * sizeof(uint64_t);
  if (state.lists != nullptr) {  // the emitted pairs stay until they are sorted
    if (absl::Status full = state.lists->Need(2 * pair_bytes); !full.ok()) return full;
    state.lists->Hold(pair_bytes);
  }
  state.pairs = HostArray<uint64_t>(ends[buckets - 1]);
  uint64_t* const pairs = state.pairs.data();
  absl::Status s = ParallelChunks(int64_t(chunks), 1, state.job, [&](int64_t first, int64_t last) {
    for (int64_t chunk = first; chunk < last; ++chunk) {
      uint64_t* const next = &offset[size_t(chunk) * buckets];
      state.emitted[size_t(chunk)].ForEach([&](uint64_t pair) { pairs[next[pair >> 32 >> shift]++] = pair; });
      state.emitted[size_t(chunk)].clear();
    }
  });
  if (!s.ok()) return s;
  std::vector<std::vector<TileRun>> runs(buckets);
  tbb::enumerable_thread_specific<BucketSort> sorts;
  s = ParallelChunks(int64_t(buckets), 4, state.job, [&](int64_t first, int64_t last) {
    for (int64_t bucket = first; bucket < last; ++bucket) {
      const uint64_t begin = bucket == 0 ? 0 : ends[bucket - 1], end = ends[bucket];
      if (begin == end) continue;
      if (shift > 0) {
        sorts.local().Sort(pairs + begin, end - begin, uint64_t(bucket) << shift, uint64_t{1} << shift);
      }
      AppendRuns(pairs, begin, end, runs[size_t(bucket)]);
    }
  });
  if (!s.ok()) return s;
  size_t count = 0;
  for (const std::vector<TileRun>& some : runs) count += some.size();
  state.runs.reserve(count);
  for (const std::vector<TileRun>& some : runs) state.runs.insert(state.runs.end(), some.begin(), some.end());
  return absl::OkStatus();
}

}  // namespace voxelpipe::cpu
