#include "request_text/request_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

std::string Error(const RequestOptions& options) {
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(options);
  EXPECT_EQ(request.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(request.status().message());
}

TEST(BuildRequest, DefaultsAreThoseOfTheRequest) {
  const VoxelizeRequest request = BuildRequest({}).value();
  EXPECT_EQ(request.grid.resolution, 128);
  EXPECT_EQ(request.grid.fit, GridFit::kTight);
  EXPECT_FALSE(request.grid.voxel_size || request.grid.dims || request.grid.origin);
  EXPECT_EQ(request.grid.padding, 0);
  EXPECT_EQ(request.coverage, Coverage::kConservative);
  EXPECT_EQ(request.fill, Fill::kNone);
  EXPECT_EQ(request.layout, Layout::kInterleaved);
  EXPECT_EQ(request.backend, BackendChoice::kAuto);
  EXPECT_EQ(request.vertex_shader, (ShaderCall{"identity", {}}));
  EXPECT_EQ(request.targets.size(), 1u);
}

TEST(BuildRequest, TakesEveryOption) {
  RequestOptions options;
  options.resolution = 50;
  options.fit = "cube";
  options.padding = 3;
  options.coverage = "thin";
  options.fill = "parity";
  options.layout = "planar";
  options.backend = "cpu";
  options.threads = 2;
  options.targets = {"bit:or", "f32x3:replace:shader=normal"};
  const VoxelizeRequest request = BuildRequest(options).value();
  EXPECT_EQ(request.grid.resolution, 50);
  EXPECT_EQ(request.grid.fit, GridFit::kCube);
  EXPECT_EQ(request.grid.padding, 3);
  EXPECT_EQ(request.coverage, Coverage::kThin);
  EXPECT_EQ(request.fill, Fill::kParity);
  EXPECT_EQ(request.layout, Layout::kPlanar);
  EXPECT_EQ(request.backend, BackendChoice::kCpu);
  EXPECT_EQ(request.threads, 2);
  EXPECT_EQ(request.targets.size(), 2u);
}

TEST(BuildRequest, TakesAGridThatIsGiven) {
  RequestOptions options;
  options.dims = "4,5,6";
  options.origin = "-1,0,1";
  options.voxel_size = "0.5";
  const VoxelizeRequest request = BuildRequest(options).value();
  EXPECT_EQ(request.grid.dims, (std::array<int64_t, 3>{4, 5, 6}));
  EXPECT_EQ(request.grid.origin, (Vec3d{-1, 0, 1}));
  EXPECT_EQ(request.grid.voxel_size, (Vec3d{0.5, 0.5, 0.5}));
}

TEST(BuildRequest, RefusesOptionsThatExcludeOneAnother) {
  EXPECT_THAT(Error({.resolution = 5, .voxel_size = "1"}), HasSubstr("exclude"));
  EXPECT_EQ(BuildRequest({.dims = "1,2,3"})->grid.dims, (std::array<int64_t, 3>{1, 2, 3})) << "fitted";
  EXPECT_THAT(Error({.resolution = 4, .dims = "1,1,1"}), HasSubstr("--resolution and --dims"));
  EXPECT_THAT(Error({.dims = "1,1,1", .fit = "cube"}), HasSubstr("not with --dims"));
  EXPECT_THAT(Error({.origin = "1,1,1"}), HasSubstr("all three"));
  EXPECT_THAT(Error({.voxel_size = "1", .dims = "1,1,1"}), HasSubstr("all three"));
  EXPECT_THAT(Error({.dims = "1,1,1", .origin = "0,0,0"}), HasSubstr("all three"));
  EXPECT_THAT(Error({.origin = "0,0,0"}), HasSubstr("all three"));
  EXPECT_THAT(Error({.voxel_size = "1", .fit = "cube"}), HasSubstr("--fit"));
}

TEST(BuildRequest, RulesOfPartsAreCountedAndNeedParts) {
  RequestOptions options;
  options.part_labels = {"a=1"};
  EXPECT_EQ(Error(options), "--part-label: goes with --parts file, node, mesh or material");
  options.parts = "node";
  options.part_labels.assign(kMaxPartRules, "a=1");
  EXPECT_EQ(BuildRequest(options)->parts.labels.size(), kMaxPartRules);
  options.part_labels.push_back("b=2");
  EXPECT_EQ(Error(options), "--part-label: 1001 given; at most 1000");
  options.part_labels.clear();
  options.exclude.assign(kMaxPartRules + 1, "a");
  EXPECT_EQ(Error(options), "--exclude: 1001 given; at most 1000");
  options.parts = "nodes";
  EXPECT_THAT(Error(options), HasSubstr("--parts: unknown choice 'nodes'; did you mean 'node'?"));
}

TEST(BuildRequest, NamesTheOptionAtFault) {
  EXPECT_THAT(Error({.resolution = 0}), HasSubstr("--resolution"));
  EXPECT_THAT(Error({.voxel_size = "x"}), HasSubstr("--voxel-size: 'x'"));
  EXPECT_THAT(Error({.fit = "loose"}), HasSubstr("--fit: unknown choice 'loose'; known are tight, cube"));
  EXPECT_THAT(Error({.padding = -1}), HasSubstr("--padding"));
  EXPECT_THAT(Error({.coverage = "fat"}), HasSubstr("--coverage: unknown choice 'fat'"));
  EXPECT_THAT(Error({.fill = "mud"}),
              HasSubstr("--fill: unknown choice 'mud'; known are none, parity, nonzero, flood"));
  EXPECT_THAT(Error({.result = "octree"}),
              HasSubstr("--result: unknown choice 'octree'; known are dense, sparse, buckets"));
  EXPECT_THAT(Error({.simd = "mmx"}), HasSubstr("--simd: unknown choice 'mmx'; known are auto, avx512, avx2, scalar"));
  EXPECT_THAT(Error({.targets = {"f32:add:scale=2"}}), HasSubstr("scale: is for integer formats"));
  EXPECT_THAT(Error({.shader = "nope"}), HasSubstr("--shader"));
  EXPECT_THAT(Error({.shader = "constant:nope=1"}), HasSubstr("nope"));
  EXPECT_THAT(Error({.vertex_shader = "nope"}), HasSubstr("nope"));
  EXPECT_THAT(Error({.targets = {"bit:max"}}), HasSubstr("max"));
  EXPECT_THAT(Error({.targets = {"bit:or:shader=nope"}}), HasSubstr("nope"));
  EXPECT_THAT(Error({.targets = {"f32:add:quantum=0.3"}}), HasSubstr("quantum"));
  EXPECT_THAT(Error({.layout = "diagonal"}), HasSubstr("--layout"));
  EXPECT_THAT(Error({.backend = "fpga"}), HasSubstr("--backend"));
  EXPECT_THAT(Error({.threads = -1}), HasSubstr("--threads"));
}

}  // namespace
}  // namespace voxelpipe
