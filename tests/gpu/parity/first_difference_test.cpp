// A comparison that finds nothing must mean that there is nothing.
#include "gpu/parity/first_difference.h"

#include <set>

#include "gpu/cases/parity_cases.h"
#include "gtest/gtest.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

Delivered MakeDelivered(Layout layout, PartScope parts = PartScope::kWhole) {
  VoxelizeRequest request;
  request.grid.dims = {5, 4, 3};
  request.grid.origin = Vec3d{0, 0, 0};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.layout = layout;
  request.fill = Fill::kParity;
  request.parts.scope = parts;
  TargetSpec values;
  values.format = VoxelFormat::kF32;
  values.components = 2;
  values.blend = Blend::kMax;
  request.targets = {TargetSpec{}, values};
  const absl::StatusOr<VoxelizeResult> result = Voxelize(voxelpipe::testing::Cube(2), request, {JobContext()});
  EXPECT_TRUE(result.ok()) << result.status();
  Delivered delivered;
  delivered.header = HeaderOf(*result);
  delivered.stats = result->stats;
  for (const auto& bytes : ArraysOf(*result)) delivered.arrays.emplace_back(bytes.begin(), bytes.end());
  return delivered;
}

TEST(FirstDifference, IsNoneBetweenAResultAndItself) {
  EXPECT_EQ(FirstDifference(MakeDelivered(Layout::kPlanar), MakeDelivered(Layout::kPlanar)), std::nullopt);
}

TEST(FirstDifference, NamesVoxelComponentAndValues) {
  const Delivered a = MakeDelivered(Layout::kInterleaved);
  Delivered b = a;
  b.arrays[0][1] ^= 0x08;  // voxel 11: x 1, y 2, z 0
  EXPECT_EQ(*FirstDifference(a, b), "target0 voxel 1,2,0 component 0: 0x1 and 0x0; 1 of 60 differ");
  b = a;
  b.arrays[1][4 * (2 * 20 + 1) + 3] = 0x41;  // voxel 20: x 0, y 0, z 1
  EXPECT_EQ(FirstDifference(a, b)->substr(0, 35), "target1 voxel 0,0,1 component 1: 0 ");
  const Delivered c = MakeDelivered(Layout::kPlanar);
  b = c;
  b.arrays[1][4 * (60 + 21) + 3] = 0x41;
  EXPECT_EQ(FirstDifference(c, b)->substr(0, 35), "target1 voxel 1,0,1 component 1: 0 ");
}

TEST(FirstDifference, NamesEntriesOfTheTableOfParts) {
  const Delivered a = MakeDelivered(Layout::kInterleaved, PartScope::kNode);
  size_t at = 0;
  while (at < a.header.arrays.size() && a.header.arrays[at].name != "part_voxels") ++at;
  ASSERT_LT(at, a.arrays.size());
  Delivered b = a;
  b.arrays[at][0] ^= 0x01;
  EXPECT_EQ(FirstDifference(a, b)->substr(0, 18), "part_voxels[0]: 0x");
}

TEST(FirstDifference, SeesUnusedBitsCountsAndLengths) {
  const Delivered a = MakeDelivered(Layout::kInterleaved);
  Delivered b = a;
  b.arrays[0][7] ^= 0x80;
  EXPECT_EQ(*FirstDifference(a, b), "target0 differs in its unused bits");
  b = a;
  ++b.stats.occupied;
  EXPECT_TRUE(FirstDifference(a, b));
  b = a;
  ++*b.stats.odd_columns;
  EXPECT_TRUE(FirstDifference(a, b));
  b = a;
  b.arrays[1].pop_back();
  EXPECT_TRUE(FirstDifference(a, b));
  b = a;
  b.header.grid.origin.x += 1;
  EXPECT_TRUE(FirstDifference(a, b));
}

// Every word that a request can be made of occurs, on the meshes that are to have them all.
TEST(ParityCases, HoldEveryCoverageFillKindFormatBlendAndShader) {
  const ParityMesh named = ParityMeshes(1).front();
  std::set<std::string> words;
  for (const ParityCase& c : CasesFor(named, named.make(), {300, true, true}, 1)) {
    const std::vector<std::string> features = FeaturesOf(c);
    words.insert(features.begin(), features.end());
  }
  for (const char* word : {"dense",
                           "sparse",
                           "buckets",
                           "conservative",
                           "thin",
                           "center",
                           "fill=none",
                           "fill=parity",
                           "fill=flood",
                           "none",
                           "fill=nonzero",
                           "planar",
                           "slabs",
                           "streamed",
                           "one target",
                           "several targets",
                           "vertex:transform",
                           "vertex:displace_along_normal",
                           "components:4",
                           "shader:base_color",
                           "shader:attribute",
                           "shader:velocity"}) {
    EXPECT_TRUE(words.contains(word)) << word;
  }
  int formats = 0, blends = 0, shaders = 0;
  for (const std::string& word : words) {
    formats += word.starts_with("format:");
    blends += word.starts_with("blend:");
    shaders += word.starts_with("shader:");
  }
  EXPECT_EQ(formats, 6);
  EXPECT_EQ(blends, 9);
  EXPECT_GE(shaders, 20);
}

}  // namespace
}  // namespace voxelpipe::gpu
