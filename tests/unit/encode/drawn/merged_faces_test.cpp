#include "encode/drawn/merged_faces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using Faces = std::map<std::tuple<int64_t, int64_t, int64_t, int>, uint64_t>;  // voxel and side to colour

std::vector<MergedFace> Merged(const VoxelizeResult& result, const std::function<uint64_t(uint64_t)>& colour_of) {
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  MemoryCharge memory(&DefaultMemory());
  return MergeFaces(volume, colour_of, nullptr, memory).value();
}

VoxelizeResult Solid(std::array<int64_t, 3> dims, const testing::BitFormula& formula) {
  VoxelizeResult result = testing::EmptyResult(dims);
  testing::AddBits(result, formula);
  return result;
}

TEST(MergeFaces, ABoxOfOneColourHasSix) {
  const VoxelizeResult box = Solid({50, 6, 7}, [](int64_t i, int64_t j, int64_t k) {
    return i >= 3 && i < 44 && j >= 1 && j < 5 && k >= 2 && k < 6;
  });
  const std::vector<MergedFace> faces = Merged(box, [](uint64_t) { return 7; });
  ASSERT_EQ(faces.size(), 6u);
  std::set<int> sides;
  for (const MergedFace& face : faces) {
    sides.insert(face.side);
    const size_t axis = size_t(face.side / 2);
    std::array<int64_t, 3> low = {3, 1, 2}, high = {43, 4, 5};
    (face.side % 2 == 0 ? high : low)[axis] = (face.side % 2 == 0 ? low : high)[axis];
    EXPECT_EQ(face.low, low) << face.side;
    EXPECT_EQ(face.high, high) << face.side;
    EXPECT_EQ(face.colour, 7u);
  }
  EXPECT_EQ(sides.size(), 6u);
}

TEST(MergeFaces, ColoursAndHolesDivide) {
  const VoxelizeResult plate = Solid({4, 4, 1}, [](int64_t, int64_t, int64_t) { return true; });
  const auto on_top = [](const std::vector<MergedFace>& faces) {
    return std::count_if(faces.begin(), faces.end(), [](const MergedFace& face) { return face.side == 5; });
  };
  EXPECT_EQ(on_top(Merged(plate, [](uint64_t n) { return n % 4 / 2; })), 2) << "two halves along x";
  EXPECT_EQ(on_top(Merged(plate, [](uint64_t n) { return n; })), 16) << "each its own colour";
  const VoxelizeResult ring =
      Solid({4, 4, 1}, [](int64_t i, int64_t j, int64_t) { return i == 0 || i == 3 || j == 0 || j == 3; });
  EXPECT_EQ(on_top(Merged(ring, [](uint64_t) { return 0; })), 4);
}

TEST(MergeFaces, CoversEachExposedFaceOnceInItsColour) {
  const VoxelizeResult result = Solid({70, 9, 11}, [](int64_t i, int64_t j, int64_t k) {
    return (uint64_t(i / 3) * 2654435761u ^ uint64_t(j / 2) * 40503u ^ uint64_t(k) * 97u) % 5 < 3;
  });
  const auto colour_of = [](uint64_t n) { return n / 5 % 3; };
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  Faces expected;
  JobPoll poll(nullptr);
  for (int64_t k = 0; k < 11; ++k) {
    const absl::Status visited = VisitFaces(volume, k, poll, [&](int64_t i, int64_t j, uint64_t n, int side) {
      expected[{i, j, k, side}] = colour_of(n);
    });
    ASSERT_TRUE(visited.ok()) << visited;
  }
  Faces covered;
  const std::vector<MergedFace> faces = Merged(result, colour_of);
  for (const MergedFace& face : faces) {
    for (int64_t k = face.low[2]; k <= face.high[2]; ++k) {
      for (int64_t j = face.low[1]; j <= face.high[1]; ++j) {
        for (int64_t i = face.low[0]; i <= face.high[0]; ++i) {
          EXPECT_TRUE(covered.try_emplace({i, j, k, face.side}, face.colour).second) << "covered twice";
        }
      }
    }
  }
  EXPECT_EQ(covered, expected);
  EXPECT_LT(faces.size(), expected.size() / 2);
  const std::vector<MergedFace> again = Merged(result, colour_of);
  ASSERT_EQ(again.size(), faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    EXPECT_EQ(again[f].low, faces[f].low);
    EXPECT_EQ(again[f].side, faces[f].side);
  }
}

TEST(MergeFaces, EndsWithItsJob) {
  const VoxelizeResult plate = Solid({4, 4, 1}, [](int64_t, int64_t, int64_t) { return true; });
  const PreviewVolume volume = PreviewVolume::Build(plate, nullptr).value();
  JobContext job;
  job.Cancel();
  MemoryCharge memory(&DefaultMemory());
  EXPECT_EQ(MergeFaces(
                volume, [](uint64_t) { return 0; }, &job, memory)
                .status()
                .code(),
            absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace voxelpipe
