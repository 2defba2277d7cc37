// Files that break a rule of glTF, or use what most readers do not: what loads with a warning, what is an error.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "load/base/data_uri.h"
#include "load/gltf/document/gltf_extensions.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "mesh/texture_faults.h"
#include "support/meshes/glb_builder.h"
#include "support/warnings.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::ByteVector;
using testing::Codes;
using ::testing::ElementsAre;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::Lines;

// A unit box that stands at x.
GlbBuilder Box(bool with_scene = true) {
  GlbBuilder builder;
  const testing::Shape cube = testing::CubeShape();
  const int mesh = builder.Mesh(builder.Primitive(cube.positions, cube.indices));
  const int child = builder.Node({{"mesh", mesh}, {"translation", {5, 0, 0}}});
  const int root = builder.Node({{"children", {child}}, {"translation", {0, 7, 0}}});
  if (with_scene) builder.Scene({root});
  return builder;
}

TriangleMesh Flat(const ByteVector& file) {
  const absl::StatusOr<Scene> scene = LoadScene(file);
  EXPECT_TRUE(scene.ok()) << scene.status();
  absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return *std::move(mesh);
}

absl::StatusOr<DataUri> Decode(const std::string& uri) {
  const JobContext endless;
  return DecodeDataUri(endless, uri);
}

ByteVector Text(const std::string& text) {
  return {text.begin(), text.end()};
}

TEST(GltfConformance, DataUrisAreTheSameInAnyCase) {
  for (const char* head : {"data:application/octet-stream;base64,", "DATA:;BASE64,", "Data:; base64 ,",
                           "data:Application/Octet-Stream;charset=x;Base64,"}) {
    const absl::StatusOr<DataUri> data = Decode(std::string(head) + "AQID");
    ASSERT_TRUE(data.ok()) << head << data.status();
    EXPECT_THAT(data->bytes, ElementsAre(1, 2, 3)) << head;
    EXPECT_TRUE(IsDataUri(head));
  }
  EXPECT_EQ(Decode("data:IMAGE/Png;base64,AQID")->media_type, "image/png");
  EXPECT_THAT(Decode("data:text/plain;charset=utf-8,a%62")->bytes, ElementsAre('a', 'b'));
  EXPECT_FALSE(IsDataUri("datax:,"));
  EXPECT_FALSE(IsDataUri("dat"));
  for (const char* unknown : {"data:;base32,AQID", "data:application/gzip;gzip,AQID"}) {
    const absl::Status status = Decode(unknown).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr("which is unknown"));
  }
}

TEST(GltfConformance, LongDataUrisAreDecodedInSteps) {
  ByteVector bytes(1'000'001);
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = uint8_t(i * 7 + i / 251);
  const std::string text = testing::Base64(bytes);
  const absl::StatusOr<DataUri> data = Decode("data:;base64," + text);
  ASSERT_TRUE(data.ok()) << data.status();
  EXPECT_EQ(data->bytes, bytes);
  JobContext over;
  over.Cancel();
  EXPECT_EQ(DecodeDataUri(over, "data:;base64," + text).status().code(), absl::StatusCode::kCancelled);
}

TEST(GltfConformance, AByteOrderMarkLoadsWithAWarning) {
  const std::string mark = "\xEF\xBB\xBF";
  const ByteVector text = Box().Gltf();
  const TriangleMesh plain = Flat(text);
  const TriangleMesh marked = Flat(Text(mark + std::string(text.begin(), text.end())));
  EXPECT_EQ(marked.triangles, plain.triangles);
  EXPECT_THAT(Codes(plain.warnings), IsEmpty());
  EXPECT_THAT(Lines(marked.warnings), ElementsAre(HasSubstr("byte order mark")));
  GlbBuilder builder = Box();
  builder.doc["buffers"] = {{{"byteLength", builder.bin.size()}}};
  const TriangleMesh glb = Flat(testing::PackGlb(mark + builder.doc.dump(), builder.bin));
  EXPECT_THAT(Codes(glb.warnings), ElementsAre("nonconforming_file"));
}

TEST(GltfConformance, BytesBehindAGlbLoadWithAWarning) {
  ByteVector file = Box().Glb();
  const size_t declared = file.size();
  file.insert(file.end(), 5, 0xAB);
  const TriangleMesh mesh = Flat(file);
  EXPECT_EQ(mesh.triangles.size(), 12u);
  EXPECT_THAT(Lines(mesh.warnings), ElementsAre(HasSubstr("5 bytes after the length")));
  file.resize(declared - 1);
  EXPECT_THAT(std::string(LoadScene(file).status().message()), HasSubstr("the length field says"));
}

TEST(GltfConformance, WithoutScenesTheRootsAreTaken) {
  for (const bool empty_list : {false, true}) {
    GlbBuilder builder = Box(false);
    if (empty_list) builder.doc["scenes"] = json::array();
    const TriangleMesh mesh = Flat(builder.Glb());
    EXPECT_EQ(mesh.triangles, Flat(Box().Glb()).triangles);
    EXPECT_EQ(mesh.positions, Flat(Box().Glb()).positions) << "the child is drawn once, below its parent";
    EXPECT_THAT(Codes(mesh.warnings), ElementsAre("no_scene"));
  }
}

TEST(GltfConformance, WithoutNodesEachMeshIsTakenOnce) {
  GlbBuilder builder;
  const testing::Shape cube = testing::CubeShape();
  for (int i = 0; i < 2; ++i) builder.Mesh(builder.Primitive(cube.positions, cube.indices));
  const TriangleMesh mesh = Flat(builder.Glb());
  EXPECT_EQ(mesh.triangles.size(), 24u);
  EXPECT_THAT(Codes(mesh.warnings), ElementsAre("no_scene"));
  LoadLimits limits;
  limits.max_nodes = 1;
  EXPECT_EQ(LoadScene(builder.Glb(), MeshFormat::kAuto, limits).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(GltfConformance, AnEmptySceneStaysEmptyAndAMissingOneIsAnError) {
  GlbBuilder builder = Box(false);
  builder.doc["scenes"] = {{{"nodes", json::array()}}};
  const TriangleMesh mesh = Flat(builder.Glb());
  EXPECT_TRUE(mesh.triangles.empty());
  EXPECT_THAT(Codes(mesh.warnings), ElementsAre("no_triangles"));
  EXPECT_THAT(Lines(mesh.warnings), ElementsAre(HasSubstr("the scene is empty")));
  GlbBuilder dangling = Box(false);
  dangling.doc["scene"] = 0;
  EXPECT_FALSE(LoadScene(dangling.Glb()).ok());
}

TEST(GltfConformance, WhyThereIsNoTriangleIsSaid) {
  const auto reasons = [](GlbBuilder builder) { return Lines(Flat(builder.Glb()).warnings); };
  GlbBuilder points = Box();
  points.doc["meshes"][0]["primitives"][0]["mode"] = 0;
  EXPECT_THAT(reasons(points), ElementsAre(HasSubstr("mesh 0: 1 of 1 primitives are points or lines"),
                                           HasSubstr("the scene has only points or lines")));
  GlbBuilder bare = Box();
  bare.doc["nodes"][0].erase("mesh");
  EXPECT_THAT(reasons(bare), ElementsAre(HasSubstr("no node of the scene has a mesh")));
  GlbBuilder some = Box();
  json lines = some.doc["meshes"][0]["primitives"][0];
  lines["mode"] = 1;
  some.doc["meshes"][0]["primitives"].push_back(lines);
  EXPECT_THAT(reasons(some), ElementsAre(HasSubstr("1 of 2 primitives are points or lines")));
}

TEST(GltfConformance, RequiredExtensionsAreReadIgnoredOrRefused) {
  using gltf::ExtensionSupport;
  for (const char* name : {"KHR_draco_mesh_compression", "KHR_meshopt_compression", "EXT_texture_webp", "CESIUM_RTC"}) {
    EXPECT_EQ(gltf::SupportOf(name), ExtensionSupport::kRead) << name;
  }
  for (const char* name :
       {"EXT_mesh_features", "EXT_structural_metadata", "EXT_lights_ies", "KHR_audio_emitter",
        "KHR_physics_rigid_bodies", "KHR_interactivity", "VRMC_vrm", "VRM", "MSFT_lod", "MSFT_texture_dds",
        "CESIUM_primitive_outline", "KHR_gaussian_splatting", "KHR_materials_clearcoat", "KHR_lights_punctual"}) {
    EXPECT_EQ(gltf::SupportOf(name), ExtensionSupport::kIgnored) << name;
    GlbBuilder builder = Box();
    builder.doc["extensionsRequired"] = {name};
    const TriangleMesh mesh = Flat(builder.Glb());
    EXPECT_EQ(mesh.triangles.size(), 12u);
    EXPECT_THAT(Codes(mesh.warnings), ElementsAre("extension_ignored")) << name;
    EXPECT_THAT(Lines(mesh.warnings), ElementsAre(HasSubstr(name)));
  }
  for (const char* name : {"", "ACME_gizmo", "KHR_mesh_primitive_restart", "KHR_draco_mesh_compression2"}) {
    EXPECT_EQ(gltf::SupportOf(name), ExtensionSupport::kRefused) << name;
  }
}

TEST(GltfConformance, CesiumsCentreMovesWhatIsDrawn) {
  GlbBuilder builder = Box();
  const double x = 6378137.25;
  builder.doc["extensionsRequired"] = {"CESIUM_RTC"};
  builder.doc["extensions"]["CESIUM_RTC"]["center"] = {x, -2, 0.5};
  const TriangleMesh mesh = Flat(builder.Glb()), plain = Flat(Box().Glb());
  ASSERT_EQ(mesh.positions.size(), plain.positions.size());
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    EXPECT_EQ(mesh.positions[i], plain.positions[i] + (Vec3d{x, -2, 0.5})) << "in double";
  }
  EXPECT_THAT(Codes(mesh.warnings), IsEmpty());
  for (const json& center : {json(), json({1, 2}), json({1, 2, "x"}), json(7)}) {
    builder.doc["extensions"]["CESIUM_RTC"]["center"] = center;
    EXPECT_THAT(std::string(LoadScene(builder.Glb()).status().message()), HasSubstr("CESIUM_RTC")) << center;
  }
}

// A texture whose image only an extension names, and images that are not there.
TEST(GltfConformance, TexturesSayWhatIsWrongToWhoReadsThem) {
  GlbBuilder builder = Box();
  builder.doc["images"] = {{{"uri", "gone.png"}}, {{"uri", "data:image/webp;base64,AQID"}}};
  builder.doc["textures"] = {
      {{"source", 0}}, {{"extensions", {{"EXT_texture_webp", {{"source", 1}}}}}}, json::object()};
  builder.doc["materials"] = {
      {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}, {"emissiveTexture", {{"index", 9}}}},
      {{"emissiveTexture", {{"index", 2}}}}};
  builder.doc["meshes"][0]["primitives"][0]["material"] = 0;
  const TriangleMesh mesh = Flat(builder.Glb());
  EXPECT_THAT(Codes(mesh.warnings), IsEmpty());
  EXPECT_EQ(mesh.textures[1].image, 1);
  const auto warned = [&](const TextureUse& use) {
    WarningList warnings;
    AddTextureWarnings(mesh, use, warnings);
    return Lines(warnings);
  };
  EXPECT_THAT(warned({}), IsEmpty());
  EXPECT_THAT(warned({.base_color = true}),
              ElementsAre(HasSubstr("image 0: the URI 'gone.png'"), HasSubstr("no TEXCOORD_0 for the base colour")));
  EXPECT_THAT(warned({.emissive = true}), ElementsAre("material 0: emissive texture: texture 9 does not exist; the "
                                                      "material's factor is used"));
  EXPECT_THAT(warned({.metallic_roughness = true}), IsEmpty());
  WarningList all;
  AddAllTextureWarnings(mesh, all);
  EXPECT_THAT(Lines(all), ElementsAre(HasSubstr("image 0"), HasSubstr("material 0"), HasSubstr("texture 2: names no"),
                                      HasSubstr("no TEXCOORD_0")));
}

// A few hundred bytes of instances make millions of parts: each primitive is spoken of once, and that takes no time.
TEST(GltfConformance, InstancesWithoutCoordinatesAreOneWarning) {
  TriangleMesh mesh;
  mesh.materials.resize(1);
  mesh.materials[0].base_color.texture = 0;
  mesh.textures.resize(1);
  mesh.textures[0].image = 0;
  mesh.images = {std::make_shared<Image>()};
  mesh.images[0]->rgba.resize(4);
  MeshPart part;
  part.triangle_count = 1;
  part.material = 0;
  mesh.parts.assign(200'000, part);
  mesh.parts.back().primitive = 1;
  WarningList warnings;
  AddTextureWarnings(mesh, {.base_color = true}, warnings);
  EXPECT_THAT(Lines(warnings), ElementsAre(HasSubstr("mesh 0, primitive 0: no TEXCOORD_0"),
                                           HasSubstr("mesh 0, primitive 1: no TEXCOORD_0")));
  EXPECT_EQ(warnings.left_out(), 0u);
}

TEST(GltfConformance, FaultsOfMaterialsAreWarnings) {
  GlbBuilder builder = Box();
  builder.doc["materials"] = {{{"emissiveFactor", {1, 2}}, {"alphaMode", "GLASS"}},
                              {{"pbrMetallicRoughness", {{"baseColorFactor", "red"}}}},
                              7};
  EXPECT_THAT(
      Lines(Flat(builder.Glb()).warnings),
      ElementsAre(HasSubstr("material 0: emissiveFactor is not 3 numbers"), HasSubstr("material 0: alphaMode"),
                  HasSubstr("material 1: baseColorFactor is not 4"), HasSubstr("material 2: is not an object")));
}

}  // namespace
}  // namespace voxelpipe
