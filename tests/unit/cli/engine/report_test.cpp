#include "engine/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace voxelpipe::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

VoxelizeStats Sample(double raster_ms, double wall_ms, double cpu_ms) {
  VoxelizeStats stats;
  stats.stages = {{"vertex_shade", 1}, {"fine_raster", raster_ms}};
  stats.voxelize_ms = wall_ms;
  stats.voxelize_cpu_ms = cpu_ms;
  return stats;
}

TEST(Medians, OfOddAndEvenCounts) {
  const MedianTimes odd = Medians({Sample(9, 30, 60), Sample(5, 10, 20), Sample(7, 20, 50)});
  EXPECT_THAT(odd.stages, ElementsAre(Pair("vertex_shade", 1), Pair("fine_raster", 7)));
  EXPECT_EQ(odd.voxelize_ms, 20);
  EXPECT_EQ(odd.voxelize_cpu_ms, 50);
  EXPECT_EQ(odd.voxelize_cpu_ms_min, 20);
  EXPECT_EQ(Medians({Sample(9, 30, 60), Sample(5, 10, 20)}).voxelize_ms, 20);
  EXPECT_EQ(Medians({Sample(9, 30, 60)}).voxelize_cpu_ms, 60);
}

TEST(VoxelizeJson, HasTheNamesThatUsersRelyOn) {
  EngineRun run;
  VoxelizeStats stats = Sample(5, 10, 20);
  stats.triangles = 12;
  stats.backend = "cpu";
  run.mesh_stages = {{"load", 2}, {"flatten", 3}};
  run.runs = {stats};
  VoxelizeReport report;
  report.header.grid.dims = {2, 3, 4};
  report.hash = "00";
  nlohmann::ordered_json json = VoxelizeJson(run, report);
  for (const char* name :
       {"triangles", "triangles_outside", "dims", "origin", "voxel_size", "occupied", "fragments", "odd_columns",
        "open_edges", "backend", "simd", "bytes", "peak_bytes", "hash", "stages", "voxelize_ms", "voxelize_cpu_ms"}) {
    EXPECT_TRUE(json.contains(name)) << name;
  }
  EXPECT_TRUE(json["odd_columns"].is_null());
  EXPECT_EQ(json["stages"].size(), 4u);
  EXPECT_FALSE(json["stages"].contains("encode"));
  EXPECT_FALSE(json.contains("voxelize_cpu_ms_min"));
  run.runs.push_back(Sample(5, 10, 16));
  run.open_edges = 0;
  report.encoded = true;
  json = VoxelizeJson(run, report);
  EXPECT_EQ(json["voxelize_cpu_ms_min"], 16);
  EXPECT_EQ(json["open_edges"], 0);
  EXPECT_TRUE(json["stages"].contains("encode"));
}

TEST(PrintError, IsOneLineWhateverTheMessageHolds) {
  ::testing::internal::CaptureStderr();
  PrintError("a\nb.glb", absl::InvalidArgumentError("one\ntwo\x1b[31m\tthree"));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "voxelpipe: a?b.glb: one?two?[31m?three\n");
}

// A name in one line of a table must not pass for another line.
TEST(PrintLines, EachIsOneLineWhateverItsNamesHold) {
  ::testing::internal::CaptureStdout();
  EXPECT_TRUE(PrintLines({"a\n  watertight  yes", TableRow("name", "\x1b[31m\u009b1m\u202e\u00e9", 6)}).ok());
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "a?  watertight  yes\n  name  ?[31m?1m?\u00e9\n");
}

TEST(JsonText, HasNoControlCharacterAndTheSameValue) {
  const nlohmann::ordered_json json = {{"name", "\x1b\x7f\u009b\u202e\u2069\u200f\u061c\u2028\n\u00e9"}};
  const std::string text = JsonText(json);
  EXPECT_EQ(text, R"({"name":"\u001b\u007f\u009b\u202e\u2069\u200f\u061c\u2028\n)"
                  "\u00e9\"}");
  EXPECT_EQ(nlohmann::ordered_json::parse(text), json);
  EXPECT_EQ(JsonText({{"path", "\xff"}}), "{\"path\":\"\ufffd\"}");
}

TEST(HumanNumbers, AreShort) {
  EXPECT_EQ(WithCommas(0), "0");
  EXPECT_EQ(WithCommas(999), "999");
  EXPECT_EQ(WithCommas(1000), "1,000");
  EXPECT_EQ(WithCommas(12345678), "12,345,678");
  EXPECT_EQ(HumanBytes(1023), "1023 bytes");
  EXPECT_EQ(HumanBytes(1536), "1.5 KiB");
  EXPECT_EQ(HumanBytes(uint64_t{3} << 40), "3.0 TiB");
}

}  // namespace
}  // namespace voxelpipe::cli
