// The sort of (tile, triangle) pairs against the library's.
#include <algorithm>
#include <random>

#include "cpu/run_state.h"
#include "gtest/gtest.h"

namespace voxelpipe::cpu {
namespace {

// Chunks of pairs by ascending triangle, as CoarseRaster emits them: up to three tiles a triangle.
std::vector<std::vector<uint64_t>> RandomPairs(uint64_t tiles, uint64_t triangles, size_t chunks, uint32_t seed) {
  std::mt19937_64 random(seed);
  std::vector<std::vector<uint64_t>> emitted(chunks);
  for (uint64_t t = 0; t < triangles; ++t) {
    for (uint64_t i = random() % 4; i > 0; --i) {
      // Half of them in few tiles, so that runs are long too.
      const uint64_t tile = random() % 2 == 0 ? random() % std::min<uint64_t>(tiles, 7) : random() % tiles;
      emitted[size_t(t * chunks / triangles)].push_back(tile << 32 | t);
    }
  }
  return emitted;
}

void ExpectSorted(const std::array<int64_t, 3>& dims, uint64_t triangles, size_t chunks) {
  const TriangleMesh mesh;
  const BoundRequest request;
  const JobContext job;
  RunState state(mesh, request, job);
  for (int a = 0; a < 3; ++a) state.tiles.dims[a] = dims[size_t(a)];
  const auto emitted = RandomPairs(state.tiles.count(), triangles, chunks, uint32_t(triangles));
  state.emitted.resize(emitted.size());
  std::vector<uint64_t> expected;
  for (size_t i = 0; i < emitted.size(); ++i) {
    for (const uint64_t pair : emitted[i]) state.emitted[i].push_back(pair);
    expected.insert(expected.end(), emitted[i].begin(), emitted[i].end());
  }
  std::stable_sort(expected.begin(), expected.end(), [](uint64_t a, uint64_t b) { return a >> 32 < b >> 32; });
  ASSERT_TRUE(TileSort(state).ok());
  ASSERT_EQ(std::vector<uint64_t>(state.pairs.data(), state.pairs.data() + state.pairs.size()), expected);
  uint64_t at = 0, before = 0;
  for (const TileRun& run : state.runs) {
    ASSERT_EQ(run.begin, at);
    ASSERT_LT(run.begin, run.end);
    const uint64_t tile = expected[run.begin] >> 32;
    ASSERT_TRUE(run.begin == 0 || tile > before);
    for (uint64_t i = run.begin; i < run.end; ++i) ASSERT_EQ(expected[i] >> 32, tile);
    before = tile;
    at = run.end;
  }
  EXPECT_EQ(at, expected.size());
}

TEST(TileSort, IsStableByTileWhateverTheNumberOfTiles) {
  for (const std::array<int64_t, 3>& dims :
       {std::array<int64_t, 3>{1, 1, 1}, {4, 16, 16}, {33, 32, 1}, {17, 31, 41}, {128, 512, 512}, {65535, 65535, 1}}) {
    for (const uint64_t triangles : {0, 1, 100, 60000}) {
      for (const size_t chunks : {1, 3, 40}) ExpectSorted(dims, triangles, chunks);
    }
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
