// Values of the shaders that read materials, against numbers worked out by hand.
#include <cmath>

#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "mesh/views/material_views.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "support/shading.h"

namespace voxelpipe {
namespace {

using testing::FloatAt;
using testing::Floats;
using testing::FloatTarget;
using testing::RunPipeline;
using testing::ShadeOne;
using testing::ShadingScene;

// Red, green / blue, white from the top; alpha 255, 255 / 0, 128.
constexpr uint8_t kTexels[16] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 0, 255, 255, 255, 128};
constexpr Vec3f kCorner{1, 0, 0};

// One textured material; uv is the same at every corner, so that it is what the fragment samples.
struct TexturedScene : ShadingScene {
  Vec2f uv[3];
  TextureView texture;

  TexturedScene() {
    texture.rgba = kTexels;
    texture.width = texture.height = 2;
    texture.nearest = true;
    texture.srgb = true;
    part.has_uv[0] = true;
  }
  MeshView View(const Vec2f& at) {
    uv[0] = uv[1] = uv[2] = at;
    textures = {texture};
    MeshView view = ShadingScene::View();
    view.uv[0] = uv;
    return view;
  }
};

TEST(BaseColorTest, MultipliesFactorTextureAndVertexColour) {
  TexturedScene scene;
  const Vec4f colors[3] = {{0.5f, 0.5f, 0.5f, 0.5f}, {}, {}};
  scene.materials[0].base_color_factor = {0.5f, 1, 1, 1};
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.25f, 0.25f}), {"base_color", {}}, kCorner)), (Vec4f{0.5f, 1, 1, 1}));
  scene.materials[0].base_color.texture = 0;
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.25f, 0.25f}), {"base_color", {}}, kCorner)), (Vec4f{0.5f, 0, 0, 1}));
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.25f, 0.75f}), {"base_color", {}}, kCorner)), (Vec4f{0, 0, 1, 0}));
  scene.part.has_colors = true;
  MeshView view = scene.View({0.75f, 0.25f});
  view.colors = colors;
  EXPECT_EQ(Floats(ShadeOne(view, {"base_color", {}}, kCorner)), (Vec4f{0, 0.5f, 0, 0.5f}));
}

TEST(BaseColorTest, WithoutTextureCoordinatesTheFactorAloneServes) {
  TexturedScene scene;
  scene.materials[0].base_color.texture = 0;
  scene.materials[0].base_color.uv_set = 1;  // the part has set 0 only
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.25f, 0.25f}), {"base_color", {}}, kCorner)), (Vec4f{1, 1, 1, 1}));
}

TEST(EmissiveTest, MultipliesFactorAndTexture) {
  TexturedScene scene;
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.75f, 0.75f}), {"emissive", {}}, kCorner)), (Vec4f{0, 0, 0, 1}));
  scene.materials[0].emissive_factor = {4, 0.5f, 2};
  scene.materials[0].emissive.texture = 0;
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.25f, 0.25f}), {"emissive", {}}, kCorner)), (Vec4f{4, 0, 0, 1}));
  EXPECT_EQ(Floats(ShadeOne(scene.View({0.75f, 0.75f}), {"emissive", {}}, kCorner)), (Vec4f{4, 0.5f, 2, 1}));
}

TEST(MetallicRoughnessTest, TakesBlueAndGreenOfTheLinearTexture) {
  const uint8_t texel[4] = {9, 102, 51, 255};
  TexturedScene scene;
  scene.texture.rgba = texel;
  scene.texture.width = scene.texture.height = 1;
  scene.texture.srgb = false;
  scene.materials[0].metallic_factor = 0.5f;
  EXPECT_EQ(Floats(ShadeOne(scene.View({0, 0}), {"metallic_roughness", {}}, kCorner)), (Vec4f{0.5f, 1, 0, 1}));
  scene.materials[0].metallic_roughness.texture = 0;
  EXPECT_EQ(Floats(ShadeOne(scene.View({0, 0}), {"metallic_roughness", {}}, kCorner)),
            (Vec4f{0.5f * 0.2f, 0.4f, 0, 1}));
}

TEST(AlphaMaskTest, DiscardsInEveryShaderThatReadsTheMaterialAndInNoOther) {
  TexturedScene scene;
  scene.materials[0].base_color.texture = 0;
  scene.materials[0].alpha_cutoff = 0.5f;
  const auto discards = [&](const char* shader, const Vec2f& uv) {
    return ShadeOne(scene.View(uv), {shader, {}}, kCorner).discard;
  };
  const Vec2f clear{0.25f, 0.75f}, half{0.75f, 0.75f}, opaque{0.25f, 0.25f};
  for (const char* shader : {"base_color", "emissive", "metallic_roughness"}) {
    scene.materials[0].alpha_mask = false;
    EXPECT_FALSE(discards(shader, clear)) << shader;
    scene.materials[0].alpha_mask = true;
    EXPECT_TRUE(discards(shader, clear)) << shader;
    EXPECT_FALSE(discards(shader, half)) << shader;  // 128/255 is above the cutoff
    EXPECT_FALSE(discards(shader, opaque)) << shader;
    EXPECT_TRUE(FindShader(ShaderStage::kFragment, shader)->can_discard) << shader;
  }
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage == ShaderStage::kVertex || info.can_discard) continue;
    ShaderCall call{info.name, {}};
    if (info.name == "attribute") call.text["name"] = "_HEAT";
    EXPECT_FALSE(ShadeOne(scene.View(clear), call, kCorner).discard) << info.name;
  }
}

// A quad over 4x4 voxels of size 1 in z = 0.5, uv (0,0) at its corner at the origin and (1,1) opposite; a decoded
// image.
TriangleMesh Quad(uint32_t edge, std::vector<uint8_t> rgba) {
  TriangleMesh mesh = testing::MakeMesh({{0, 0, 0.5}, {4, 0, 0.5}, {4, 4, 0.5}, {0, 4, 0.5}}, {{0, 1, 2}, {0, 2, 3}});
  mesh.uv[0] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.parts[0].has_uv[0] = true;
  mesh.parts[0].material = 0;
  mesh.materials.resize(1);
  mesh.materials[0].base_color.texture = 0;
  mesh.textures.resize(1);
  mesh.textures[0].image = 0;
  auto image = std::make_shared<Image>();
  image->width = image->height = edge;
  image->rgba = std::move(rgba);
  mesh.images = {image};
  return mesh;
}

std::vector<uint8_t> Checkerboard(uint32_t edge) {
  std::vector<uint8_t> rgba;
  for (uint32_t i = 0; i < edge * edge; ++i) {
    const uint8_t v = (i % edge + i / edge) % 2 == 0 ? 255 : 0;
    rgba.insert(rgba.end(), {v, v, v, 255});
  }
  return rgba;
}

VoxelizeRequest Request(const char* shader) {
  VoxelizeRequest request;
  request.grid = testing::UnitGrid(4, 4, 1);
  request.targets = {FloatTarget(4, Blend::kReplace, {shader, {}})};
  return request;
}

TEST(MinificationTest, AFineCheckerboardGivesItsMeanInEveryVoxel) {
  TriangleMesh mesh = Quad(256, Checkerboard(256));
  ASSERT_TRUE(PrepareTextures(mesh, {}, TexturesRead(Request("base_color"))).ok());
  const VoxelizeResult result = RunPipeline(mesh, Request("base_color"));
  for (uint64_t i = 0; i < 16; ++i) EXPECT_EQ(FloatAt(result.targets[0], 4 * i), 0.5f) << i;
}

TEST(MinificationTest, ANearestFilterWithoutMipsTakesTexels) {
  TriangleMesh mesh = Quad(256, Checkerboard(256));
  mesh.textures[0].mip_filter = MipFilter::kNone;
  mesh.textures[0].min_nearest = true;
  ASSERT_TRUE(PrepareTextures(mesh).ok());
  EXPECT_TRUE(mesh.images[0]->srgb_mips.empty()) << "nothing reads them";
  const VoxelizeResult result = RunPipeline(mesh, Request("base_color"));
  for (uint64_t i = 0; i < 16; ++i) {
    const float v = FloatAt(result.targets[0], 4 * i);
    EXPECT_TRUE(v == 0 || v == 1) << v;
  }
}

TEST(TextureTransformTest, OffsetsRotatesAndScales) {
  TriangleMesh mesh = Quad(2, {std::begin(kTexels), std::end(kTexels)});
  mesh.textures[0].nearest = mesh.textures[0].min_nearest = true;
  const auto first = [&] {
    const VoxelizeResult result = RunPipeline(mesh, Request("base_color"));
    const HostBuffer& values = result.targets[0];
    return Vec4f{FloatAt(values, 0), FloatAt(values, 1), FloatAt(values, 2), FloatAt(values, 3)};  // uv (1/8, 1/8)
  };
  EXPECT_EQ(first(), (Vec4f{1, 0, 0, 1}));
  TextureRef& ref = mesh.materials[0].base_color;
  ref.offset[0] = 0.5f;
  EXPECT_EQ(first(), (Vec4f{0, 1, 0, 1}));
  ref.scale[1] = 5;  // (5/8, 5/8)
  EXPECT_EQ(first(), (Vec4f{1, 1, 1, 128.0f / 255}));
  ref = TextureRef{.texture = 0};
  ref.scale[0] = 5;
  ref.rotation = float(std::acos(0.0));  // (5/8, 1/8) turns to (1/8, -5/8), which wraps to (1/8, 3/8)
  EXPECT_EQ(first(), (Vec4f{1, 0, 0, 1}));
  ref.scale[0] = 3;  // (3/8, 1/8) turns to (1/8, -3/8): (1/8, 5/8)
  EXPECT_EQ(first(), (Vec4f{0, 0, 1, 0}));
}

TEST(MaterialViewsTest, StrengthScalesTheEmissiveFactorAndTheDefaultMaterialComesLast) {
  TriangleMesh mesh;
  mesh.materials.resize(1);
  mesh.materials[0].emissive_factor = {0.5f, 1, 0};
  mesh.materials[0].emissive_strength = 8;
  mesh.materials[0].roughness_factor = 0.25f;
  mesh.materials[0].alpha_mode = AlphaMode::kMask;
  const MaterialViews views = MakeMaterialViews(mesh);
  ASSERT_EQ(views.materials.size(), 2u);
  EXPECT_EQ(views.materials[0].emissive_factor, (Vec3f{4, 8, 0}));
  EXPECT_EQ(views.materials[0].roughness_factor, 0.25f);
  EXPECT_TRUE(views.materials[0].alpha_mask);
  EXPECT_EQ(views.materials[1].metallic_factor, 1);
  EXPECT_FALSE(views.materials[1].alpha_mask);
}

}  // namespace
}  // namespace voxelpipe
