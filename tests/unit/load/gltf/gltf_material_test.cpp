// Materials, textures and images of glTF: read where they are right, harmless where they are not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "load/loader.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::ByteVector;
using ::testing::Contains;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

GlbBuilder OneTriangle() {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["material"] = 0;
  builder.Scene({builder.Node({{"mesh", builder.Mesh(primitive)}})});
  return builder;
}

TEST(GltfMaterial, FiltersFollowTheSampler) {
  struct Case {
    int mag, min;
    bool nearest, min_nearest;
    MipFilter mips;
  };
  const Case cases[] = {{0, 0, false, false, MipFilter::kLinear},       {9728, 0, true, true, MipFilter::kLinear},
                        {0, 9728, true, true, MipFilter::kNone},        {9729, 9729, false, false, MipFilter::kNone},
                        {9729, 9984, false, true, MipFilter::kNearest}, {9728, 9985, true, false, MipFilter::kNearest},
                        {9729, 9986, false, true, MipFilter::kLinear},  {9728, 9987, true, false, MipFilter::kLinear}};
  for (const Case& c : cases) {
    GlbBuilder builder = OneTriangle();
    builder.doc["images"] = {{{"bufferView", 0}}};
    json sampler = json::object();
    if (c.mag != 0) sampler["magFilter"] = c.mag;
    if (c.min != 0) sampler["minFilter"] = c.min;
    builder.doc["samplers"] = json::array({sampler});
    builder.doc["textures"] = {{{"source", 0}, {"sampler", 0}}};
    const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
    ASSERT_TRUE(scene.ok()) << scene.status();
    ASSERT_THAT(scene->textures, SizeIs(1));
    const Texture& texture = scene->textures[0];
    EXPECT_EQ(texture.nearest, c.nearest) << c.mag << " " << c.min;
    EXPECT_EQ(texture.min_nearest, c.min_nearest) << c.mag << " " << c.min;
    EXPECT_EQ(texture.mip_filter, c.mips) << c.mag << " " << c.min;
  }
}

TEST(GltfMaterial, EmissiveStrengthIsRead) {
  GlbBuilder builder = OneTriangle();
  json material = {{"emissiveFactor", {1, 0.5, 0}}};
  material["extensions"]["KHR_materials_emissive_strength"] = {{"emissiveStrength", 6.5}};
  builder.doc["materials"] = {material, json::object()};
  const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->materials[0].emissive_strength, 6.5f);
  EXPECT_EQ(scene->materials[1].emissive_strength, 1);
}

TEST(GltfMaterial, FactorsModesAndTextureReferences) {
  GlbBuilder builder = OneTriangle();
  builder.doc["images"] = {{{"bufferView", builder.View({1, 2, 3})}, {"mimeType", "image/png"}, {"name", "wood"}}};
  builder.doc["samplers"] = {{{"magFilter", 9728}, {"wrapS", 33071}, {"wrapT", 33648}}};
  builder.doc["textures"] = {{{"source", 0}, {"sampler", 0}}, {{"source", 0}}};
  json base_color = {{"index", 0}, {"texCoord", 1}};
  base_color["extensions"]["KHR_texture_transform"] = {{"offset", {0.5, 0.25}}, {"rotation", 1.5}, {"scale", {2, 3}}};
  builder.doc["materials"] = {{{"name", "m"},
                               {"pbrMetallicRoughness",
                                {{"baseColorFactor", {0.5, 0.25, 0.125, 1}},
                                 {"baseColorTexture", base_color},
                                 {"metallicFactor", 0.5},
                                 {"roughnessFactor", 0.25}}},
                               {"emissiveFactor", {0, 1, 0}},
                               {"emissiveTexture", {{"index", 1}}},
                               {"alphaMode", "MASK"},
                               {"alphaCutoff", 0.75},
                               {"doubleSided", true}}};
  const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].material, 0);
  ASSERT_THAT(scene->materials, SizeIs(1));
  const Material& material = scene->materials[0];
  EXPECT_EQ(material.base_color_factor, (Vec4f{0.5f, 0.25f, 0.125f, 1}));
  EXPECT_EQ(material.base_color.texture, 0);
  EXPECT_EQ(material.base_color.uv_set, 1);
  EXPECT_EQ(material.base_color.offset[1], 0.25f);
  EXPECT_EQ(material.base_color.scale[1], 3);
  EXPECT_EQ(material.base_color.rotation, 1.5f);
  EXPECT_EQ(material.metallic_factor, 0.5f);
  EXPECT_EQ(material.emissive_factor, (Vec3f{0, 1, 0}));
  EXPECT_EQ(material.emissive.texture, 1);
  EXPECT_EQ(material.alpha_mode, AlphaMode::kMask);
  EXPECT_EQ(material.alpha_cutoff, 0.75f);
  EXPECT_TRUE(material.double_sided);
  ASSERT_THAT(scene->textures, SizeIs(2));
  EXPECT_TRUE(scene->textures[0].nearest);
  EXPECT_EQ(scene->textures[0].wrap_s, WrapMode::kClampToEdge);
  EXPECT_EQ(scene->textures[0].wrap_t, WrapMode::kMirroredRepeat);
  EXPECT_FALSE(scene->textures[1].nearest);
  EXPECT_EQ(scene->textures[1].mip_filter, MipFilter::kLinear);
  ASSERT_THAT(scene->images, SizeIs(1));
  EXPECT_EQ(scene->images[0]->encoded, (ByteVector{1, 2, 3}));
  EXPECT_EQ(scene->images[0]->width, 0u) << "images are decoded only when a shader needs them";
}

TEST(GltfMaterial, ImagesInDataUrisAndOutsideTheDocument) {
  GlbBuilder builder = OneTriangle();
  builder.doc["images"] = {
      {{"uri", "data:image/png;base64,AQID"}}, {{"uri", "wood.png"}}, {{"uri", "data:image/png;base64,&&&&"}}};
  builder.doc["textures"] = {{{"source", 0}}, {{"source", 1}}, {{"source", 2}}};
  builder.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 1}}}}}}};
  const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->images[0]->encoded, (ByteVector{1, 2, 3}));
  EXPECT_EQ(scene->images[0]->mime_type, "image/png");
  EXPECT_EQ(scene->textures[0].image, 0);
  EXPECT_EQ(scene->images[0]->fault, std::nullopt);
  for (const int i : {1, 2}) {
    EXPECT_EQ(scene->textures[size_t(i)].image, i);
    ASSERT_TRUE(scene->images[size_t(i)]->fault.has_value());
    EXPECT_EQ(scene->images[size_t(i)]->fault->code, WarningCode::kTextureMissing);
  }
  EXPECT_THAT(scene->images[1]->fault->Line(), HasSubstr("image 1: the URI 'wood.png' leads to no file"));
  EXPECT_TRUE(scene->warnings.empty()) << "a texture matters only to who reads it";
}

TEST(GltfMaterial, DiffuseOfSpecularGlossinessServesAsBaseColour) {
  GlbBuilder builder = OneTriangle();
  builder.doc["images"] = {{{"uri", "data:image/png;base64,AQID"}}};
  builder.doc["textures"] = {{{"source", 0}}};
  json material = json::object();
  material["extensions"]["KHR_materials_pbrSpecularGlossiness"] = {{"diffuseFactor", {0.5, 0.5, 0.25, 1}},
                                                                   {"diffuseTexture", {{"index", 0}, {"texCoord", 1}}}};
  builder.doc["materials"] = json::array({material});
  const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->materials[0].base_color_factor, (Vec4f{0.5f, 0.5f, 0.25f, 1}));
  EXPECT_EQ(scene->materials[0].base_color.texture, 0);
  EXPECT_EQ(scene->materials[0].base_color.uv_set, 1);
}

TEST(GltfMaterial, WrongTypesNeverCostTheGeometry) {
  const json wrong[] = {json(7),
                        json("text"),
                        json::array({1, "a", nullptr}),
                        json::object({{"index", "x"}}),
                        json(nullptr),
                        json(-1.5),
                        json(true),
                        json(1e300)};
  const char* const paths[] = {
      "/materials/0",
      "/materials/0/pbrMetallicRoughness",
      "/materials/0/pbrMetallicRoughness/baseColorFactor",
      "/materials/0/pbrMetallicRoughness/baseColorTexture",
      "/materials/0/pbrMetallicRoughness/baseColorTexture/index",
      "/materials/0/pbrMetallicRoughness/baseColorTexture/texCoord",
      "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions",
      "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform",
      "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/offset",
      "/materials/0/emissiveFactor",
      "/materials/0/alphaMode",
      "/materials/0/alphaCutoff",
      "/materials/0/doubleSided",
      "/materials/0/name",
      "/materials/0/extensions/KHR_materials_pbrSpecularGlossiness",
      "/materials/0/extensions/KHR_materials_pbrSpecularGlossiness/diffuseTexture",
      "/meshes/0/primitives/0/material",
      "/textures/0",
      "/textures/0/source",
      "/textures/0/sampler",
      "/samplers/0",
      "/samplers/0/wrapS",
      "/images/0",
      "/images/0/bufferView",
      "/images/0/uri",
      "/images/0/mimeType"};
  for (const char* path : paths) {
    for (const json& value : wrong) {
      GlbBuilder builder = OneTriangle();
      builder.doc["images"] = {{{"bufferView", 0}}};
      builder.doc["samplers"] = json::array({json::object()});
      builder.doc["textures"] = {{{"source", 0}, {"sampler", 0}}};
      json base_color = {{"index", 0}};
      base_color["extensions"]["KHR_texture_transform"] = {{"offset", {0, 0}}};
      builder.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", base_color}}}}};
      builder.doc[json::json_pointer(path)] = value;
      const absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
      ASSERT_TRUE(scene.ok()) << path << " = " << value << ": " << scene.status();
      ASSERT_THAT(scene->meshes[0].primitives[0].triangles, SizeIs(1));
      for (const Texture& texture : scene->textures) EXPECT_LT(texture.image, static_cast<int>(scene->images.size()));
      for (const Material& material : scene->materials) {
        EXPECT_LT(material.base_color.texture, static_cast<int>(scene->textures.size()));
        EXPECT_GE(material.base_color.uv_set, 0);
        EXPECT_LE(material.base_color.uv_set, 1);
      }
      EXPECT_LT(scene->meshes[0].primitives[0].material, static_cast<int>(scene->materials.size()));
    }
  }
}

}  // namespace
}  // namespace voxelpipe
