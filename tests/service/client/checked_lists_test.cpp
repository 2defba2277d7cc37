// A sink gets the lists of a server's result when they agree, and nothing of others.
#include "reply/checked_lists.h"

#include <cstring>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Notes all that it receives, array by array.
struct Noting : ResultSink {
  absl::Status Begin(const ResultHeader& header) override {
    arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    arrays[array].append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    return absl::OkStatus();
  }
  std::vector<std::string> arrays;
};

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

// Buckets over 4 x 4 x 4 voxels with one u8 target, and what came of them in pieces of three bytes.
absl::Status Send(const std::vector<uint64_t>& voxels, const std::vector<uint64_t>& offsets,
                  const std::vector<uint32_t>& triangles, Noting& sink) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  request.targets[0].format = VoxelFormat::kU8;
  GridSpec grid;
  grid.dims = {4, 4, 4};
  CheckedLists checked(sink);
  if (absl::Status s = checked.Begin(MakeResultHeader(request, grid, 0, voxels.size(), triangles.size())); !s.ok()) {
    return s;
  }
  const std::string arrays[] = {Bytes(voxels), Bytes(offsets), Bytes(triangles), std::string(triangles.size(), 'v')};
  for (size_t i = 0; i < std::size(arrays); ++i) {
    for (size_t at = 0; at < arrays[i].size(); at += 3) {
      const std::string piece = arrays[i].substr(at, 3);
      if (absl::Status s = checked.Write(i, {reinterpret_cast<const uint8_t*>(piece.data()), piece.size()}); !s.ok()) {
        return s;
      }
    }
  }
  return checked.Finish();
}

TEST(CheckedListsTest, TheSinkGetsWhatAgrees) {
  Noting sink;
  ASSERT_TRUE(Send({3, 63}, {0, 2, 3}, {5, 9, 1}, sink).ok());
  EXPECT_EQ(sink.arrays, (std::vector<std::string>{Bytes<uint64_t>({3, 63}), Bytes<uint64_t>({0, 2, 3}),
                                                   Bytes<uint32_t>({5, 9, 1}), "vvv"}));
}

TEST(CheckedListsTest, AResultWithoutVoxelsHasItsListsToo) {
  Noting sink;
  ASSERT_TRUE(Send({}, {0}, {}, sink).ok());
  EXPECT_EQ(sink.arrays, (std::vector<std::string>{"", Bytes<uint64_t>({0}), "", ""}));
}

TEST(CheckedListsTest, TheSinkGetsNothingThatPointsOutside) {
  const auto refused = [](const std::vector<uint64_t>& voxels, const std::vector<uint64_t>& offsets) {
    Noting sink;
    const absl::Status status = Send(voxels, offsets, {5, 9, 1}, sink);
    return status.code() == absl::StatusCode::kDataLoss && sink.arrays == std::vector<std::string>(4);
  };
  EXPECT_TRUE(refused({3, 64}, {0, 2, 3}));
  EXPECT_TRUE(refused({3, UINT64_MAX}, {0, 2, 3}));
  EXPECT_TRUE(refused({3, 63}, {0, UINT64_MAX, 3}));
  EXPECT_TRUE(refused({3, 63}, {0, 2, 4}));
}

// A dense result of 4 x 4 x 4 voxels and two parts, in pieces of three bytes.
absl::Status SendParts(const std::vector<uint32_t>& labels, const std::vector<uint64_t>& name_offsets, Noting& sink) {
  VoxelizeRequest request;
  request.targets[0].format = VoxelFormat::kU8;
  GridSpec grid;
  grid.dims = {4, 4, 4};
  CheckedLists checked(sink);
  if (absl::Status s = checked.Begin(DenseHeader(request, grid, {2, false, 7})); !s.ok()) return s;
  const std::string arrays[] = {std::string(64, 'v'),      Bytes(labels),       Bytes<int32_t>({0, -1}),
                                Bytes<uint64_t>({12, 10}), Bytes(name_offsets), "hullleg"};
  for (size_t i = 0; i < std::size(arrays); ++i) {
    for (size_t at = 0; at < arrays[i].size(); at += 3) {
      const std::string piece = arrays[i].substr(at, 3);
      if (absl::Status s = checked.Write(i, {reinterpret_cast<const uint8_t*>(piece.data()), piece.size()}); !s.ok()) {
        return s;
      }
    }
  }
  return checked.Finish();
}

TEST(CheckedListsTest, TheSinkGetsTheTableOfPartsWhenItAgrees) {
  Noting sink;
  ASSERT_TRUE(SendParts({1, 7}, {0, 4, 7}, sink).ok());
  EXPECT_EQ(sink.arrays,
            (std::vector<std::string>{std::string(64, 'v'), Bytes<uint32_t>({1, 7}), Bytes<int32_t>({0, -1}),
                                      Bytes<uint64_t>({12, 10}), Bytes<uint64_t>({0, 4, 7}), "hullleg"}));
}

TEST(CheckedListsTest, TheSinkGetsNoTableOfPartsThatPointsOutside) {
  const auto refused = [](const std::vector<uint32_t>& labels, const std::vector<uint64_t>& name_offsets) {
    Noting sink;
    const absl::Status status = SendParts(labels, name_offsets, sink);
    std::vector<std::string> values_alone(6);
    values_alone[0] = std::string(64, 'v');
    return status.code() == absl::StatusCode::kDataLoss && sink.arrays == values_alone;
  };
  EXPECT_TRUE(refused({1, 0}, {0, 4, 7})) << "a label of 0";
  EXPECT_TRUE(refused({1, 7}, {1, 4, 7}));
  EXPECT_TRUE(refused({1, 7}, {0, 8, 7}));
  EXPECT_TRUE(refused({1, 7}, {0, UINT64_MAX, 7}));
  EXPECT_TRUE(refused({1, 7}, {0, 4, 3}));
  EXPECT_TRUE(refused({1, 7}, {0, 4, 6}));
}

}  // namespace
}  // namespace voxelpipe
