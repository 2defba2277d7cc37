// A textured glTF file through loader, flattening, textures and pipeline: every value worked out by hand.
#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "shaders/catalog.h"
#include "support/meshes/glb_builder.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::ByteVector;
using testing::FloatAt;
using testing::FloatTarget;
using testing::GlbBuilder;

constexpr uint32_t kEdge = 64;

// Texels alternate between (255, 102, 51) and black; the image's lower half is transparent.
ByteVector Checkerboard() {
  ByteVector rgba;
  for (uint32_t y = 0; y < kEdge; ++y) {
    for (uint32_t x = 0; x < kEdge; ++x) {
      const bool lit = (x + y) % 2 == 0;
      const uint8_t alpha = y < kEdge / 2 ? 255 : 0;
      rgba.insert(rgba.end(), {uint8_t(lit ? 255 : 0), uint8_t(lit ? 102 : 0), uint8_t(lit ? 51 : 0), alpha});
    }
  }
  return rgba;
}

// The square [0,4]^2 in z = 0.5, the image's top at y = 0: 16 texels a voxel of size 1. Primitive 1, in the plane z =
// 1.5, has no material.
ByteVector File(const char* alpha_mode) {
  GlbBuilder builder;
  const std::vector<uint32_t> indices = {0, 1, 2, 0, 2, 3};
  json quad = builder.Primitive({{0, 0, 0.5f}, {4, 0, 0.5f}, {4, 4, 0.5f}, {0, 4, 0.5f}}, indices);
  quad["attributes"]["TEXCOORD_0"] = builder.Vectors({0, 0, 0, 0, 0, 0, 0, 0}, "VEC2");
  quad["attributes"]["TEXCOORD_1"] = builder.Vectors({0, 0, 1, 0, 1, 1, 0, 1}, "VEC2");
  quad["material"] = 1;
  const json bare = builder.Primitive({{0, 0, 1.5f}, {4, 0, 1.5f}, {4, 4, 1.5f}, {0, 4, 1.5f}}, indices);
  const int mesh = builder.Mesh(quad);
  builder.doc["meshes"][mesh]["primitives"].push_back(bare);
  builder.Scene({builder.Node({{"mesh", mesh}})});
  const int view = builder.View(testing::MakePng(kEdge, kEdge, Checkerboard()));
  builder.doc["images"] = {{{"bufferView", view}, {"mimeType", "image/png"}}};
  builder.doc["textures"] = {{{"source", 0}}};
  json texture = {{"index", 0}, {"texCoord", 0}};
  texture["extensions"]["KHR_texture_transform"] = {{"texCoord", 1}};  // the override counts
  json material = {{"pbrMetallicRoughness",
                    {{"baseColorTexture", texture},
                     {"metallicRoughnessTexture", texture},
                     {"metallicFactor", 0.5},
                     {"roughnessFactor", 1}}},
                   {"emissiveTexture", texture},
                   {"emissiveFactor", {1, 0, 0}},
                   {"alphaMode", alpha_mode}};
  material["extensions"]["KHR_materials_emissive_strength"] = {{"emissiveStrength", 6}};
  builder.doc["materials"] = {json::object(), material};
  return builder.Glb();
}

VoxelizeResult RunFile(const char* alpha_mode) {
  VoxelizeRequest request;
  request.grid = testing::UnitGrid(4, 4, 2);
  TargetSpec bytes = FloatTarget(4, Blend::kReplace, {"base_color", {}});
  bytes.format = VoxelFormat::kU8;
  bytes.clear = 9;
  TargetSpec id = FloatTarget(1, Blend::kReplace, {"material_id", {}});
  id.format = VoxelFormat::kU32;
  request.targets = {bytes, FloatTarget(3, Blend::kReplace, {"emissive", {}}),
                     FloatTarget(2, Blend::kReplace, {"metallic_roughness", {}}), id};
  const auto scene = LoadScene(File(alpha_mode));
  EXPECT_TRUE(scene.ok()) << scene.status();
  auto mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_TRUE(PrepareTextures(*mesh, {}, TexturesRead(request)).ok());
  return testing::RunPipeline(*mesh, request);
}

TEST(TexturedGoldenTest, EveryVoxelHoldsTheMeanOfItsTexels) {
  const VoxelizeResult result = RunFile("OPAQUE");
  for (uint64_t n = 0; n < 16; ++n) {
    EXPECT_EQ(result.targets[0].data()[4 * n], 128) << n;  // 0.5 * 255, nearest even
    EXPECT_EQ(FloatAt(result.targets[1], 3 * n), 3) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 3 * n + 1), 0) << n;
    EXPECT_NEAR(FloatAt(result.targets[2], 2 * n), 0.5 * 0.5 * 0.2, 1e-7) << n;
    EXPECT_NEAR(FloatAt(result.targets[2], 2 * n + 1), 0.5 * 0.4, 1e-7) << n;
    EXPECT_EQ(reinterpret_cast<const uint32_t*>(result.targets[3].data())[n], 1u) << n;
  }
  for (uint64_t n = 16; n < 32; ++n) {  // glTF's default material
    EXPECT_EQ(result.targets[0].data()[4 * n], 255) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 3 * n), 0) << n;
    EXPECT_EQ(FloatAt(result.targets[2], 2 * n), 1) << n;
    EXPECT_EQ(reinterpret_cast<const uint32_t*>(result.targets[3].data())[n], 2u) << n;
  }
}

TEST(TexturedGoldenTest, AMaskRemovesFragmentsOnlyWhereTheMaterialIsRead) {
  const VoxelizeResult result = RunFile("MASK");
  for (const uint64_t n :
       {0, 1, 2, 3, 12, 13, 14, 15}) {  // the rows whose texels are opaque, or transparent, throughout
    const bool kept = n < 4;
    EXPECT_EQ(result.targets[0].data()[4 * n], kept ? 128 : 9) << n;
    EXPECT_EQ(FloatAt(result.targets[1], 3 * n), kept ? 3 : 0) << n;
    EXPECT_EQ(FloatAt(result.targets[2], 2 * n + 1) > 0, kept) << n;
    EXPECT_EQ(reinterpret_cast<const uint32_t*>(result.targets[3].data())[n], 1u) << n;
  }
}

}  // namespace
}  // namespace voxelpipe
