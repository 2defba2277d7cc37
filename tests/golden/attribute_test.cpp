// A glTF file's own attributes through loader, flattening and pipeline: every value worked out by hand.
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "support/meshes/glb_builder.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::FloatAt;
using testing::FloatTarget;
using testing::GlbBuilder;

// The square [0,4]^2 in z = 0.5 with _TEMP = 3x - 1 (floats) and _ZONE = (51, 2) of normalized bytes; the same square
// in z = 1.5 has neither.
TriangleMesh Squares() {
  GlbBuilder builder;
  const std::vector<uint32_t> indices = {0, 1, 2, 0, 2, 3};
  json square = builder.Primitive({{0, 0, 0.5f}, {4, 0, 0.5f}, {4, 4, 0.5f}, {0, 4, 0.5f}}, indices);
  square["attributes"]["_TEMP"] = builder.Vectors({-1, 11, 11, -1}, "SCALAR");
  square["attributes"]["_ZONE"] = builder.Accessor(
      builder.View({51, 255, 0, 0, 51, 255, 0, 0, 51, 255, 0, 0, 51, 255}, 4), testing::kU8, "VEC2", 4, true);
  const json bare = builder.Primitive({{0, 0, 1.5f}, {4, 0, 1.5f}, {4, 4, 1.5f}, {0, 4, 1.5f}}, indices);
  const int mesh = builder.Mesh(square);
  builder.doc["meshes"][mesh]["primitives"].push_back(bare);
  builder.Scene({builder.Node({{"mesh", mesh}})});
  const auto scene = LoadScene(builder.Glb());
  EXPECT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->warnings.kept().size(), 2u);  // one a name
  auto flat = Flatten(*scene);
  EXPECT_TRUE(flat.ok()) << flat.status();
  return *std::move(flat);
}

TEST(AttributeGoldenTest, EveryVoxelHoldsTheValueAtItsCentre) {
  VoxelizeRequest request;
  request.grid = testing::UnitGrid(4, 4, 2);
  request.coverage = Coverage::kCenter;  // no voxel whose centre lies beside the triangle
  request.targets = {FloatTarget(1, Blend::kReplace, {"attribute", {}, {{"name", "_TEMP"}}}),
                     FloatTarget(4, Blend::kReplace, {"attribute", {}, {{"name", "_ZONE"}}})};
  const VoxelizeResult result = testing::RunPipeline(Squares(), request);
  for (uint64_t n = 0; n < 16; ++n) {
    EXPECT_NEAR(FloatAt(result.targets[0], n), 3 * (double(n % 4) + 0.5) - 1, 1e-5) << n;
    EXPECT_NEAR(FloatAt(result.targets[1], 4 * n), 0.2, 1e-6) << n;
    EXPECT_NEAR(FloatAt(result.targets[1], 4 * n + 1), 1, 1e-6) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 4 * n + 2), 0) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 4 * n + 3), 1) << n;
  }
  for (uint64_t n = 16; n < 32; ++n) {
    EXPECT_EQ(FloatAt(result.targets[0], n), 0) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 4 * n), 0) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 4 * n + 1), 0) << n;
  }
}

}  // namespace
}  // namespace voxelpipe
