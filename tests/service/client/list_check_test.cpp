// Inconsistent lists are refused.
#include "reply/list_check.h"

#include <cstring>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

template <typename T>
HostBuffer Buffer(const std::vector<T>& values) {
  HostBuffer buffer = *HostBuffer::Allocate(values.size() * sizeof(T));
  if (!values.empty()) std::memcpy(buffer.data(), values.data(), buffer.size());
  return buffer;
}

// A result with one u8 target over a grid of 10 x 8 x 9 voxels: 2 x 1 x 2 bricks.
VoxelizeResult Empty(ResultKind kind) {
  VoxelizeResult result;
  result.kind = kind;
  result.grid.dims = {10, 8, 9};
  TargetSpec target;
  target.format = VoxelFormat::kU8;
  result.specs = {target};
  return result;
}

// `masks`: of each brick the bytes that are not 0, by their place.
absl::Status Sparse(const std::vector<uint64_t>& bricks, const std::vector<std::vector<std::pair<size_t, int>>>& masks,
                    size_t values) {
  VoxelizeResult result = Empty(ResultKind::kSparse);
  result.bricks = Buffer(bricks);
  std::vector<uint8_t> bytes(64 * masks.size());
  for (size_t i = 0; i < masks.size(); ++i) {
    for (const auto& [at, byte] : masks[i]) bytes[64 * i + at] = uint8_t(byte);
  }
  result.masks = Buffer(bytes);
  result.targets.push_back(Buffer(std::vector<uint8_t>(values)));
  VoxelizeRequest request;
  request.result = result.kind;
  request.targets = result.specs;
  return CheckLists(result, MakeResultHeader(request, result.grid, bricks.size(), values, 0).arrays);
}

TEST(ListCheckTest, SparseListsMustAgree) {
  const auto lost = [](const absl::Status& status) { return status.code() == absl::StatusCode::kDataLoss; };
  EXPECT_TRUE(Sparse({}, {}, 0).ok());
  EXPECT_TRUE(Sparse({0, 3}, {{{0, 0xff}, {63, 0x80}}, {{7, 3}}}, 11).ok());
  EXPECT_TRUE(lost(Sparse({3, 0}, {{{0, 1}}, {{0, 1}}}, 2))) << "bricks must ascend";
  EXPECT_TRUE(lost(Sparse({0, 0}, {{{0, 1}}, {{0, 1}}}, 2)));
  EXPECT_TRUE(lost(Sparse({4}, {{{0, 1}}}, 1))) << "beyond the grid";
  EXPECT_TRUE(lost(Sparse({UINT64_MAX}, {{{0, 1}}}, 1)));
  EXPECT_TRUE(lost(Sparse({0}, {{}}, 0))) << "an empty brick";
  EXPECT_TRUE(lost(Sparse({1}, {{{0, 4}}}, 1))) << "x = 10";
  EXPECT_TRUE(lost(Sparse({2}, {{{8, 1}}}, 1))) << "z = 9";
  EXPECT_TRUE(lost(Sparse({0}, {{{0, 3}}}, 1))) << "one value for two voxels";
  EXPECT_TRUE(lost(Sparse({0}, {{{0, 1}}}, 2)));
}

absl::Status Buckets(const std::vector<uint64_t>& voxels, const std::vector<uint64_t>& offsets,
                     const std::vector<uint32_t>& triangles) {
  VoxelizeResult result = Empty(ResultKind::kBuckets);
  result.voxels = Buffer(voxels);
  result.offsets = Buffer(offsets);
  result.triangles = Buffer(triangles);
  result.targets.push_back(Buffer(std::vector<uint8_t>(triangles.size())));
  return CheckLists(result, HeaderOf(result).arrays);
}

TEST(ListCheckTest, BucketsMustAgree) {
  const auto lost = [](const absl::Status& status) { return status.code() == absl::StatusCode::kDataLoss; };
  EXPECT_TRUE(Buckets({}, {0}, {}).ok());
  EXPECT_TRUE(Buckets({0, 719}, {0, 2, 3}, {5, 9, 1}).ok());
  EXPECT_TRUE(lost(Buckets({0, 720}, {0, 2, 3}, {5, 9, 1}))) << "beyond the grid";
  EXPECT_TRUE(lost(Buckets({7, 7}, {0, 2, 3}, {5, 9, 1}))) << "voxels must ascend";
  EXPECT_TRUE(lost(Buckets({0, 1}, {1, 2, 3}, {5, 9, 1}))) << "the first begins at 0";
  EXPECT_TRUE(lost(Buckets({0, 1}, {0, 3, 3}, {5, 9, 11}))) << "a voxel without a fragment";
  EXPECT_TRUE(lost(Buckets({0, 1}, {0, 4, 3}, {5, 9, 11}))) << "offsets must ascend";
  EXPECT_TRUE(lost(Buckets({0, 1}, {0, 1, 2}, {5, 9, 11}))) << "a fragment of no voxel";
  EXPECT_TRUE(lost(Buckets({0, 1}, {0, UINT64_MAX, 3}, {5, 9, 11})));
  EXPECT_TRUE(lost(Buckets({0, 1}, {0, 2, 3}, {9, 9, 1}))) << "triangles must ascend";
  EXPECT_TRUE(lost(Buckets({}, {0}, {1})));
}

}  // namespace
}  // namespace voxelpipe
