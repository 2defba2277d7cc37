// `voxelpipe compare`: what is equal, what differs and what cannot be compared.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "cli_runner.h"
#include "encode/encode.h"
#include "support/json/json.h"
#include "support/sanitized.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::AddBits;
using testing::AddFloats;
using testing::CliOutcome;
using testing::EmptyResult;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::SampleBit;
using testing::SampleValue;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliCompare : public ::testing::Test {
 protected:
  CliOutcome Compare(const std::string& a, const std::string& b, std::vector<std::string> options = {}) {
    options.insert(options.begin(), {"compare", directory_ / a, directory_ / b});
    return RunCli(options);
  }
  json JsonOf(const std::string& a, const std::string& b, std::vector<std::string> options = {}) {
    options.push_back("--json");
    const CliOutcome outcome = Compare(a, b, options);
    EXPECT_THAT(outcome.exit_code, ::testing::AnyOf(0, 1)) << outcome.err;
    const json report = ParseJson(outcome.out, false);
    EXPECT_EQ(report.value("equal", false), outcome.exit_code == 0);
    return report;
  }
  void Voxelize(const std::string& name, float z, std::vector<std::string> options) {
    WriteBoxGlb(directory_ / "box.glb", 1, 2, z);
    options.insert(options.begin(), {"voxelize", directory_ / "box.glb", "--dims", "12,20,44",
                                     "--origin=-0.05,-0.05,-0.05", "--voxel-size", "0.1", "-o", directory_ / name});
    const CliOutcome outcome = RunCli(options);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  }
  // Of 9 x 7 x 5 voxels: bits, and values of three components, one of which is changed.
  void Write(const std::string& name, Layout layout, float change = 0, double origin = 0) {
    VoxelizeResult result = EmptyResult({9, 7, 5}, layout);
    result.grid.origin = {origin, 0, 0};
    AddBits(result, SampleBit);
    AddFloats(result, 3, [&](int64_t i, int64_t j, int64_t k, int c) {
      return SampleValue(i, j, k, c) + (i == 4 && j == 3 && k == 2 && c == 1 ? change : 0);
    });
    ASSERT_TRUE(WriteResult(result, directory_ / name).ok());
  }

  TemporaryDirectory directory_;
};

TEST_F(CliCompare, TheFormatAndTheLayoutMakeNoDifference) {
  Write("a.npz", Layout::kInterleaved);
  for (const char* name : {"b.npz", "b.raw"}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      Write(name, layout);
      const json report = JsonOf("a.npz", name);
      EXPECT_EQ(report["equal"], true) << report;
      EXPECT_EQ(report["same_place"], true);
      EXPECT_EQ(report["occupancy"]["iou"], 1.0);
      EXPECT_EQ(report["values"]["compared"], 315);
    }
  }
}

TEST_F(CliCompare, TheFirstVoxelThatDiffersIsNamedWithBothValues) {
  Write("a.npz", Layout::kInterleaved);
  Write("b.npz", Layout::kPlanar, 0.25f);
  const json report = JsonOf("a.npz", "b.npz");
  EXPECT_EQ(report["equal"], false);
  EXPECT_EQ(report["values"]["differing"], 1);
  EXPECT_EQ(report["values"]["largest_difference"], 0.25);
  EXPECT_EQ(report["first"]["ijk"], json({4, 3, 2}));
  EXPECT_EQ(report["first"]["target"], 1);
  const float value = SampleValue(4, 3, 2, 1);
  EXPECT_EQ(report["first"]["a"][1], value);
  EXPECT_EQ(report["first"]["b"][1], value + 0.25f);
  const CliOutcome text = Compare("a.npz", "b.npz");
  EXPECT_EQ(text.exit_code, 1);
  EXPECT_THAT(text.out, HasSubstr("first       voxel (4, 3, 2), target 1: A "));
  EXPECT_THAT(text.out, HasSubstr("1 of 315 voxels differ, largest difference 0.25"));
}

TEST_F(CliCompare, ADifferenceWithinTheToleranceIsNone) {
  Write("a.npz", Layout::kInterleaved);
  Write("b.npz", Layout::kInterleaved, 0.25f);
  EXPECT_EQ(Compare("a.npz", "b.npz", {"--tolerance", "0.25"}).exit_code, 0);
  EXPECT_EQ(Compare("a.npz", "b.npz", {"--tolerance", "0.2"}).exit_code, 1);
  for (const char* bad : {"-1", "nan", "inf", "x", ""}) {
    const CliOutcome outcome = Compare("a.npz", "b.npz", {std::string("--tolerance=") + bad});
    EXPECT_EQ(outcome.exit_code, 2) << bad;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  }
}

TEST_F(CliCompare, ANaNEqualsANaNAndNothingElse) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Write("a.npz", Layout::kInterleaved);
  Write("b.npz", Layout::kInterleaved, nan);
  Write("c.npz", Layout::kPlanar, nan);
  EXPECT_EQ(Compare("b.npz", "c.npz").exit_code, 0);
  const json report = JsonOf("a.npz", "b.npz", {"--tolerance", "1e300"});
  EXPECT_EQ(report["values"]["differing"], 1);
  EXPECT_EQ(report["values"]["largest_difference"], 0.0);
  EXPECT_EQ(report["first"]["b"][1], json());
}

TEST_F(CliCompare, APlaceThatDiffersIsADifference) {
  Write("a.npz", Layout::kInterleaved);
  Write("b.npz", Layout::kInterleaved, 0, 1);
  const json report = JsonOf("a.npz", "b.npz");
  EXPECT_EQ(report["same_place"], false);
  EXPECT_EQ(report["values"]["differing"], 0);
  EXPECT_EQ(report["equal"], false);
}

TEST_F(CliCompare, DimsAndTargetsThatDifferAreADifference) {
  VoxelizeResult small = EmptyResult({3, 3, 3});
  AddBits(small, SampleBit);
  ASSERT_TRUE(WriteResult(small, directory_ / "a.npy").ok());
  VoxelizeResult large = EmptyResult({3, 3, 4});
  AddBits(large, SampleBit);
  ASSERT_TRUE(WriteResult(large, directory_ / "b.npy").ok());
  const json dims = JsonOf("a.npy", "b.npy");
  EXPECT_EQ(dims["same_dims"], false);
  EXPECT_EQ(dims["occupancy"], json());
  EXPECT_EQ(dims["same_place"], json()) << "a .npy has none";
  VoxelizeResult floats = EmptyResult({3, 3, 3});
  AddFloats(floats, 1, [](int64_t i, int64_t j, int64_t k, int) { return SampleBit(i, j, k) ? 1.0f : 0.0f; });
  ASSERT_TRUE(WriteResult(floats, directory_ / "c.npy").ok());
  const json types = JsonOf("a.npy", "c.npy");
  EXPECT_EQ(types["same_targets"], false);
  EXPECT_EQ(types["values"]["differing"], 0);
}

TEST_F(CliCompare, OccupancyIsCountedForEachKindOfResult) {
  for (const std::string kind : {"dense", "sparse", "buckets"}) {
    Voxelize("a.npz", 4, {"--result", kind});
    Voxelize("b.npz", 3, {"--result", kind});
    EXPECT_EQ(JsonOf("a.npz", "a.npz")["equal"], true);
    const json report = JsonOf("a.npz", "b.npz");
    const json& occupancy = report["occupancy"];
    EXPECT_GT(occupancy["only_a"], 0) << report;
    EXPECT_GT(occupancy["only_b"], 0);
    EXPECT_EQ(int(occupancy["a"]) - int(occupancy["only_a"]), int(occupancy["b"]) - int(occupancy["only_b"]));
    EXPECT_LT(occupancy["iou"], 1.0);
    EXPECT_EQ(report["equal"], false);
    EXPECT_FALSE(report["first"].is_null());
  }
}

TEST_F(CliCompare, BucketsAreComparedFragmentByFragment) {
  const std::vector<std::string> buckets = {"--result", "buckets", "--target", "f32x3:replace:shader=position"};
  Voxelize("a.npz", 4, buckets);
  Voxelize("b.npz", 4.03125f, buckets);  // the top stays in its layer of voxels
  const json report = JsonOf("a.npz", "b.npz", {"--tolerance", "0.01"});
  EXPECT_EQ(report["kind"], "buckets");
  EXPECT_EQ(report["occupancy"]["iou"], 1.0);
  EXPECT_GT(report["values"]["differing"], 0);
  EXPECT_LT(report["values"]["differing"], report["values"]["compared"]);
  EXPECT_EQ(report["values"]["largest_difference"], 0.03125);
  EXPECT_EQ(report["first"]["a"].size(), 3u);
  EXPECT_NE(report["first"]["a"], report["first"]["b"]);
}

TEST_F(CliCompare, WhatCannotBeComparedExitsWithTwoAndOneLine) {
  Voxelize("dense.npz", 4, {});
  Voxelize("sparse.npz", 4, {"--result", "sparse"});
  std::ofstream(directory_ / "bad.npy") << "no array, but some text";
  for (const auto& [a, b, why] : {std::tuple("dense.npz", "sparse.npz", "make both with the same --result"),
                                  {"none.npy", "dense.npz", "none.npy: no such file"},
                                  {"dense.npz", "bad.npy", "does not begin with"},
                                  {"dense.npz", "box.glb", "not a result"}}) {
    const CliOutcome outcome = Compare(a, b);
    EXPECT_EQ(outcome.exit_code, 2) << a << " " << b;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(why));
    EXPECT_EQ(outcome.out, "");
  }
}

TEST_F(CliCompare, ABrokenListIsRefusedWithItsElement) {
  Voxelize("a.npz", 4, {"--result", "sparse"});
  const std::vector<uint8_t> bytes = ReadFile(directory_ / "a.npz");
  std::string text(bytes.begin(), bytes.end());
  const size_t data = text.find("ijk.npy");
  const size_t first = text.find('\n', data) + 1;
  for (const int32_t value : {-1, 11}) {  // outside, and behind the next voxel
    std::memcpy(text.data() + first, &value, sizeof value);
    std::ofstream(directory_ / "b.npz", std::ios::binary) << text;
    const CliOutcome outcome = Compare("a.npz", "b.npz");
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_THAT(outcome.err, HasSubstr(value < 0 ? "ijk.npy: element 0 lies outside the grid"
                                                 : "ijk.npy: element 1 is not in the order of a result"));
  }
}

TEST_F(CliCompare, LargeFilesAreReadInPieces) {
  if (testing::kSanitized) GTEST_SKIP() << "the limit is too small for a sanitizer";
  const auto dense = [&](const std::string& name) {
    return RunCli(
        {"voxelize", directory_ / "box.glb", "--resolution", "400", "--fit", "cube", "-o", directory_ / name});
  };
  WriteBoxGlb(directory_ / "box.glb", 1, 2, 4);
  ASSERT_EQ(dense("a.npy").exit_code, 0);
  ASSERT_EQ(dense("b.raw").exit_code, 0);
  // Two files of 61 and 8 MiB.
  const CliOutcome outcome = RunCli({"compare", directory_ / "a.npy", directory_ / "b.raw"}, "ulimit -d 20000;");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err << outcome.out;
}

}  // namespace
}  // namespace voxelpipe
