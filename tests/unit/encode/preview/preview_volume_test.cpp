#include "encode/preview/preview_volume.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <random>
#include <set>

#include "encode/preview/preview_cells.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using Voxel = std::array<int64_t, 3>;  // x, y, z

// Too large for a bit a voxel, beside few voxels.
constexpr Voxel kDims = {1203, 701, 810};

// Clusters, lone voxels, and the corners of the grid.
std::set<Voxel> SomeVoxels() {
  std::set<Voxel> voxels = {
      {0, 0, 0}, {kDims[0] - 1, 0, 0}, {0, kDims[1] - 1, 0}, {kDims[0] - 1, kDims[1] - 1, kDims[2] - 1}};
  std::mt19937 random(7);
  for (int cluster = 0; cluster < 40; ++cluster) {
    Voxel centre;
    for (size_t a = 0; a < 3; ++a) centre[a] = int64_t(random() % uint64_t(kDims[a]));
    for (int n = 0; n < 60; ++n) {
      Voxel voxel;
      for (size_t a = 0; a < 3; ++a)
        voxel[a] = std::clamp<int64_t>(centre[a] + int64_t(random() % 9) - 4, 0, kDims[a] - 1);
      voxels.insert(voxel);
    }
  }
  return voxels;
}

uint64_t BrickOf(const Voxel& v) {
  const int64_t across = (kDims[0] + 7) / 8, rows = (kDims[1] + 7) / 8;
  return uint64_t(v[0] / 8 + across * (v[1] / 8 + rows * (v[2] / 8)));
}

// The voxels as a result of a kind that lists them.
VoxelizeResult ResultOf(ResultKind kind, const std::set<Voxel>& voxels) {
  VoxelizeRequest request;
  request.result = kind;
  GridSpec grid;
  grid.dims = kDims;
  std::map<uint64_t, std::array<uint64_t, 8>> bricks;
  std::vector<uint64_t> places, offsets;
  for (const Voxel& v : voxels) {
    bricks[BrickOf(v)][size_t(v[2] % 8)] |= uint64_t{1} << (v[0] % 8 + 8 * (v[1] % 8));
    places.push_back(uint64_t(v[0] + kDims[0] * (v[1] + kDims[1] * v[2])));
  }
  std::sort(places.begin(), places.end());
  for (uint64_t n = 0; n <= voxels.size(); ++n) offsets.push_back(n);
  VoxelizeResult result =
      AllocateResult(MakeResultHeader(request, grid, bricks.size(), voxels.size(), voxels.size())).value();
  for (const auto array : MutableArraysOf(result)) std::memset(array.data(), 0, array.size());
  if (kind == ResultKind::kBuckets) {
    std::memcpy(result.voxels.data(), places.data(), result.voxels.size());
    std::memcpy(result.offsets.data(), offsets.data(), result.offsets.size());
    return result;
  }
  size_t b = 0;
  for (const auto& [id, words] : bricks) {
    std::memcpy(result.bricks.data() + 8 * b, &id, 8);
    std::memcpy(result.masks.data() + 64 * b++, words.data(), 64);
  }
  return result;
}

// What the rows of all layers have, in their order.
std::vector<Voxel> Visited(const PreviewVolume& volume) {
  std::vector<Voxel> visited;
  JobPoll poll(nullptr);
  for (int64_t n = 0; n < volume.layers(); ++n) {
    const int64_t k = volume.Layer(n);
    EXPECT_EQ(volume.FirstLayer(k), n);
    const absl::Status s = volume.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t word) {
      for (; word != 0; word &= word - 1) visited.push_back({i + std::countr_zero(word), j, k});
    });
    EXPECT_TRUE(s.ok()) << s;
  }
  return visited;
}

std::vector<Voxel> InLinearOrder(const std::set<Voxel>& voxels) {
  std::vector<Voxel> ordered(voxels.begin(), voxels.end());
  std::sort(ordered.begin(), ordered.end(),
            [](const Voxel& a, const Voxel& b) { return std::tie(a[2], a[1], a[0]) < std::tie(b[2], b[1], b[0]); });
  return ordered;
}

class ListedVolume : public ::testing::TestWithParam<ResultKind> {
 protected:
  const std::set<Voxel> voxels_ = SomeVoxels();
  const VoxelizeResult result_ = ResultOf(GetParam(), voxels_);
  const PreviewVolume volume_ = PreviewVolume::Build(result_, nullptr).value();
};

TEST_P(ListedVolume, OfALargeGridKeepsBricksAlone) {
  EXPECT_TRUE(volume_.in_bricks());
  EXPECT_TRUE(volume_.bits().empty());
  std::vector<uint64_t> bricks;
  ASSERT_TRUE(volume_
                  .VisitBricks(nullptr,
                               [&](int64_t x, int64_t y, int64_t z) {
                                 bricks.push_back(BrickOf({8 * x, 8 * y, 8 * z}));
                               })
                  .ok());
  std::set<uint64_t> expected;
  for (const Voxel& voxel : voxels_) expected.insert(BrickOf(voxel));
  EXPECT_EQ(bricks, std::vector<uint64_t>(expected.begin(), expected.end()));
}

TEST_P(ListedVolume, HasTheVoxelsInLinearOrder) {
  EXPECT_EQ(Visited(volume_), InLinearOrder(voxels_));
}

TEST_P(ListedVolume, RowsAndNeighboursAreThoseOfTheVoxels) {
  for (const Voxel& v : voxels_) {
    for (int count : {1, 7, 8, 23, 32}) {
      for (int64_t i = v[0] - 33; i < v[0] + 3; ++i) {
        uint32_t expected = 0;
        for (int bit = 0; bit < count; ++bit) {
          if (voxels_.contains({i + bit, v[1], v[2]})) expected |= 1u << bit;
        }
        ASSERT_EQ(volume_.Row(i, v[1], v[2], count), expected) << i << " " << v[1] << " " << v[2] << " " << count;
      }
    }
    for (int64_t k = v[2] - 1; k <= v[2] + 1; ++k) {
      for (int64_t j = v[1] - 1; j <= v[1] + 1; ++j) {
        ASSERT_EQ(volume_.Solid(v[0], j, k), voxels_.contains({v[0], j, k}));
      }
    }
  }
}

TEST_P(ListedVolume, HalvedHasTheVoxelsOfTheHalfGrid) {
  const PreviewVolume half = PreviewVolume::Halved(volume_, nullptr).value();
  EXPECT_EQ(half.dims(), (Voxel{602, 351, 405}));
  std::set<Voxel> expected;
  for (const Voxel& v : voxels_) expected.insert({v[0] / 2, v[1] / 2, v[2] / 2});
  EXPECT_EQ(Visited(half), InLinearOrder(expected));
}

TEST_P(ListedVolume, RaysMeetItsVoxels) {
  const PreviewCells cells = PreviewCells::Build(volume_, nullptr).value();
  EXPECT_EQ(cells.lo(), (Voxel{0, 0, 0}));
  EXPECT_EQ(cells.hi(), kDims);
  for (const Voxel& v : voxels_) {  // from below, along z: the lowest voxel of its column
    int64_t z = v[2];
    for (int64_t k = 0; k < v[2]; ++k) {
      if (voxels_.contains({v[0], v[1], k})) z = std::min(z, k);
    }
    const PreviewHit hit = cells.Trace({double(v[0]) + 0.5, double(v[1]) + 0.5, -5}, {0, 0, 1}, 0, 2000);
    ASSERT_TRUE(hit.hit);
    ASSERT_EQ(hit.voxel, (Voxel{v[0], v[1], z}));
    ASSERT_NEAR(hit.t, double(z) + 5, 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, ListedVolume, ::testing::Values(ResultKind::kSparse, ResultKind::kBuckets),
                         [](const ::testing::TestParamInfo<ResultKind>& tested) {
                           return std::string(Name(tested.param));
                         });

}  // namespace
}  // namespace voxelpipe
