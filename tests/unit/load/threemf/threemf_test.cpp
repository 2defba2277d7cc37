#include "load/threemf/threemf.h"

#include <cstring>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "mesh/flatten.h"
#include "shaders/texture/srgb.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/zip_maker.h"
#include "support/warnings.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using testing::ErrorOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::Lines;
using testing::LoadText;
using testing::Model3mf;
using testing::Package3mf;
using testing::ZipMaker;

constexpr char k3mfVertices[] =
    "<vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"10\" y=\"0\" z=\"0\"/><vertex x=\"0\" y=\"10\" z=\"0\"/>"
    "<vertex x=\"0\" y=\"0\" z=\"1e1\"/></vertices>\n";

std::string ObjectOf(int id, const std::string& triangles, const std::string& attributes = "") {
  return absl::StrCat("<object id=\"", id, "\" type=\"model\" ", attributes, "><mesh>", k3mfVertices, "<triangles>",
                      triangles, "</triangles></mesh></object>\n");
}

std::string Model(const std::string& resources, const std::string& build, const std::string& attributes = "") {
  return Package3mf(Model3mf(resources, build, attributes)).Bytes();
}

constexpr char k3mfTriangle[] = "<triangle v1=\"0\" v2=\"1\" v3=\"2\"/>";
constexpr char k3mfItem[] = "<item objectid=\"1\"/>";

std::vector<Vec3d> FlatPositions(const std::string& file) {
  const absl::StatusOr<Scene> scene = LoadText(file);
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene, {});
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? std::vector<Vec3d>(mesh->positions.begin(), mesh->positions.end()) : std::vector<Vec3d>();
}

// Their triangles are in the model like those of a solid, and only the slicer's settings say what they are.
TEST(ThreemfTest, PartsThatASlicerCutsAwayAreNamed) {
  const std::string model = Model3mf(ObjectOf(1, k3mfTriangle), k3mfItem);
  ZipMaker prusa = Package3mf(model);
  prusa.Add("Metadata/Slic3r_PE_model.config",
            "<?xml version=\"1.0\"?><config><object id=\"1\"><metadata type=\"object\" key=\"name\" value=\"all\"/>"
            "<volume firstid=\"0\" lastid=\"0\"><metadata type=\"volume\" key=\"name\" value=\"Box\"/>"
            "<metadata type=\"volume\" key=\"volume_type\" value=\"ModelPart\"/></volume>"
            "<volume firstid=\"1\" lastid=\"1\"><metadata type=\"volume\" key=\"name\" value=\"Hole\"/>"
            "<metadata type=\"volume\" key=\"volume_type\" value=\"NegativeVolume\"/></volume></object></config>");
  EXPECT_THAT(
      Lines(LoadText(prusa.Bytes())->warnings),
      ElementsAre("Metadata/Slic3r_PE_model.config: the part 'Hole' is a NegativeVolume: a slicer cuts it away; "
                  "here it is a solid"));
  ZipMaker bambu = Package3mf(model);
  bambu.Add(
      "Metadata/model_settings.config",
      "<config><object id=\"1\"><part id=\"1\" subtype=\"normal_part\"/><part id=\"2\" subtype=\"negative_part\">"
      "<metadata key=\"name\" value=\"Cut\"/></part><part id=\"3\" subtype=\"support_blocker\"/></object></config>");
  EXPECT_THAT(Lines(LoadText(bambu.Bytes())->warnings), ElementsAre(HasSubstr("the part 'Cut' is a negative_part"),
                                                                    HasSubstr("the part '' is a support_blocker")));
  ZipMaker broken = Package3mf(model);
  broken.Add("Metadata/model_settings.config", "<config><object>");
  EXPECT_THAT(Lines(LoadText(broken.Bytes())->warnings), ElementsAre(HasSubstr("cannot be read; they are ignored")));
}

TEST(ThreemfTest, IsInMetres) {
  const std::string object = ObjectOf(1, k3mfTriangle);
  for (const auto& [unit, shown, metres] : {std::tuple{"", "mm", 0.001},
                                            {"unit=\"micron\"", "micron", 1e-6},
                                            {"unit=\"inch\"", "in", 0.0254},
                                            {"unit=\"foot\"", "ft", 0.3048},
                                            {"unit=\"meter\"", "m", 1.0},
                                            {"unit=\"centimeter\"", "cm", 0.01}}) {
    const std::string file = Model(object, k3mfItem, unit);
    const absl::StatusOr<Scene> scene = LoadText(file);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->format, "3mf");
    EXPECT_EQ(scene->unit, shown);
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
    EXPECT_EQ(FlatPositions(file)[1].x, 10 * metres);
  }
  EXPECT_THAT(ErrorOf(Model(object, k3mfItem, "unit=\"parsec\"")), HasSubstr("the unit 'parsec' is none of"));
  const absl::StatusOr<Scene> given = LoadText(Model(object, k3mfItem), {MeshFormat::k3mf, LengthUnit::kMetre});
  EXPECT_THAT(std::string(given.status().message()), HasSubstr("mesh_unit: the file has a unit of its own (mm)"));
}

TEST(ThreemfTest, FindsPartsWhateverTheirCase) {
  const auto file = [](const std::vector<std::string>& entries, const std::string& path) {
    ZipMaker zip = Package3mf(Model3mf("", absl::StrCat("<item objectid=\"1\" path=\"", path, "\"/>")));
    for (size_t i = 0; i < entries.size(); ++i) {
      // As many triangles as its number says.
      std::string triangles;
      for (size_t n = 0; n <= i; ++n) triangles += k3mfTriangle;
      zip.Add(entries[i], Model3mf(ObjectOf(1, triangles), ""));
    }
    const absl::StatusOr<Scene> scene = LoadText(zip.Bytes());
    return scene.ok() ? std::to_string(CountTriangles(*scene)) : std::string(scene.status().message());
  };
  EXPECT_EQ(file({"3D/a.model"}, "/3D/a.model"), "1");
  EXPECT_EQ(file({"3D/a.model"}, "3d/A.MODEL"), "1");
  EXPECT_EQ(file({"3D/A.model", "3D/a.model", "3d/a.Model"}, "/3D/a.model"), "2") << "the same name goes first";
  EXPECT_EQ(file({"3D/a.model", "3D/A.model", "3d/a.Model"}, "/3d/A.modeL"), "2") << "then the first by its bytes";
  EXPECT_EQ(file({"3D/a_model", "3D/a.mode", "3D/a.models", "3D/[.model"}, "/3D/{.model").find("3MF: "), 0u);
}

// Each object once copied all values of its group.
TEST(ThreemfTest, ObjectsShareTheValuesOfAGroup) {
  const std::string group =
      "<colorgroup id=\"5\"><color color=\"#FF0000\"/><color color=\"#00FF00\"/></colorgroup>"
      "<colorgroup id=\"6\"><color color=\"#0000FF\"/></colorgroup>";
  const auto triangle = [](int pid, int index) {
    return absl::StrCat("<triangle v1=\"0\" v2=\"1\" v3=\"2\" pid=\"", pid, "\" p1=\"", index, "\"/>");
  };
  const absl::StatusOr<Scene> scene =
      LoadText(Model(absl::StrCat(group, ObjectOf(1, triangle(6, 0)), ObjectOf(2, triangle(5, 1)),
                                  ObjectOf(3, triangle(6, 0) + triangle(5, 0))),
                     "<item objectid=\"1\"/><item objectid=\"2\"/><item objectid=\"3\"/>"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->meshes.size(), 3u);
  EXPECT_EQ(scene->meshes[0].primitives[0].colors[0], (Vec4f{0, 0, 1, 1}));
  EXPECT_EQ(scene->meshes[1].primitives[0].colors[0], (Vec4f{0, 1, 0, 1}));
  EXPECT_EQ(scene->meshes[2].primitives[0].colors[0], (Vec4f{0, 0, 1, 1}));
  EXPECT_EQ(scene->meshes[2].primitives[0].colors[3], (Vec4f{1, 0, 0, 1}));
}

TEST(ThreemfTest, TransformsAreForRowVectorsAndComponentsNest) {
  const std::string file =
      Model(ObjectOf(1, k3mfTriangle) +
                "<object id=\"2\"><components><component objectid=\"1\" transform=\"0 1 0 -1 0 0 0 0 1 1 2 3\"/>"
                "<component objectid=\"1\"/></components></object>",
            "<item objectid=\"2\" transform=\"2 0 0 0 2 0 0 0 2 100 0 0\"/><item objectid=\"1\"/>", "unit=\"meter\"");
  const std::vector<Vec3d> positions = FlatPositions(file);
  ASSERT_EQ(positions.size(), 9u);
  EXPECT_EQ(positions[1], (Vec3d{102, 24, 6})) << "(10,0,0) becomes (0,10,0), then (1,12,3), then twice that and 100";
  EXPECT_EQ(positions[4], (Vec3d{120, 0, 0}));
  EXPECT_EQ(positions[7], (Vec3d{10, 0, 0}));
}

TEST(ThreemfTest, PropertiesBecomeMaterialsAndColors) {
  const std::string resources =
      "<basematerials id=\"5\"><base name=\"red\" displaycolor=\"#FF0000\"/><base name=\"glass\" "
      "displaycolor=\"#0000FF80\"/></basematerials>\n"
      "<m:colorgroup id=\"6\"><m:color color=\"#800000\"/><m:color color=\"#00FF00\"/></m:colorgroup>\n" +
      ObjectOf(1,
               "<triangle v1=\"0\" v2=\"1\" v3=\"2\"/><triangle v1=\"0\" v2=\"2\" v3=\"3\" pid=\"5\" p1=\"0\"/>"
               "<triangle v1=\"0\" v2=\"1\" v3=\"3\" pid=\"6\" p1=\"0\" p2=\"1\" p3=\"0\"/>"
               "<triangle v1=\"1\" v2=\"2\" v3=\"3\" pid=\"9\" p1=\"0\"/>",
               "pid=\"5\" pindex=\"1\"");
  const absl::StatusOr<Scene> scene = LoadText(Model(resources, k3mfItem));
  ASSERT_TRUE(scene.ok()) << scene.status();
  const std::vector<Primitive>& primitives = scene->meshes[0].primitives;
  ASSERT_EQ(primitives.size(), 4u);
  EXPECT_EQ(scene->materials[size_t(primitives[0].material)].name, "glass");
  EXPECT_EQ(scene->materials[size_t(primitives[0].material)].alpha_mode, AlphaMode::kBlend);
  EXPECT_EQ(scene->materials[size_t(primitives[1].material)].base_color_factor, (Vec4f{1, 0, 0, 1}));
  EXPECT_THAT(primitives[2].colors,
              ElementsAre(Vec4f{SrgbToLinear(128), 0, 0, 1}, Vec4f{0, 1, 0, 1}, Vec4f{SrgbToLinear(128), 0, 0, 1}));
  EXPECT_EQ(primitives[3].material, -1);
  EXPECT_THAT(Lines(scene->warnings), ElementsAre("3D/3dmodel.model: the group of properties 9 does not exist"));
}

TEST(ThreemfTest, ReadsTexturesAndOtherParts) {
  const std::string textured =
      "<m:texture2d id=\"3\" path=\"/3D/Textures/a.png\" contenttype=\"image/png\" tilestyleu=\"clamp\"/>"
      "<m:texture2dgroup id=\"4\" texid=\"3\"><m:tex2coord u=\"0\" v=\"0.25\"/><m:tex2coord u=\"1\" v=\"1\"/>"
      "</m:texture2dgroup>" +
      ObjectOf(7, "<triangle v1=\"0\" v2=\"1\" v3=\"2\" pid=\"4\" p1=\"0\" p2=\"1\" p3=\"1\"/>");
  ZipMaker zip = Package3mf(Model3mf("", "<item objectid=\"7\" p:path=\"/3D/Objects/other.model\"/>"));
  zip.Add("3D/Objects/other.model", Model3mf(textured, ""));
  const testing::ByteVector png = testing::MakePng(1, 1, {1, 2, 3, 255});
  zip.Add("3D/Textures/a.png", {png.begin(), png.end()}, false);
  const absl::StatusOr<Scene> scene = LoadText(zip.Bytes());
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes.at(0).primitives.at(0);
  EXPECT_EQ(primitive.uv[0][0], (Vec2f{0, 0.75f}));
  const Material& material = scene->materials.at(size_t(primitive.material));
  ASSERT_EQ(material.base_color.texture, 0);
  EXPECT_EQ(scene->textures[0].wrap_s, WrapMode::kClampToEdge);
  EXPECT_EQ(scene->images[0]->encoded, png);
  EXPECT_THAT(scene->warnings.kept(), IsEmpty());
}

TEST(ThreemfTest, WarnsOfWhatItIgnores) {
  const std::string object = "<object id=\"1\"><mesh>" + std::string(k3mfVertices) + "<triangles>" + k3mfTriangle +
                             "</triangles><x:beams><x:beam v1=\"0\"/></x:beams></mesh><m:displacement/></object>";
  EXPECT_THAT(Lines(LoadText(Model(object, k3mfItem))->warnings),
              ElementsAre("3D/3dmodel.model, line 5: the element 'displacement' is ignored"))
      << "elements of other namespaces are left out";
  const absl::StatusOr<Scene> no_build = LoadText(Model(ObjectOf(1, k3mfTriangle), ""));
  ASSERT_TRUE(no_build.ok()) << no_build.status();
  EXPECT_THAT(testing::Codes(no_build->warnings), ElementsAre("no_scene"));
  EXPECT_EQ(no_build->meshes.size(), 1u);
}

// As some exporters write them: the second mesh's indices count from its own vertices.
TEST(ThreemfTest, SeveralMeshesOfAnObjectAreAddedWithAWarning) {
  const std::string mesh = std::string("<mesh>") + k3mfVertices + "<triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/>";
  const std::string other = std::string("</triangles></mesh>\n<mesh>") +
                            "<vertices><vertex x=\"1\" y=\"2\" z=\"30\"/><vertex x=\"40\" y=\"2\" z=\"30\"/>"
                            "<vertex x=\"1\" y=\"50\" z=\"30\"/></vertices><triangles>";
  const auto file = [&](const std::string& triangle) {
    return Model("<object id=\"1\">" + mesh + other + triangle + "</triangles></mesh></object>", k3mfItem);
  };
  const absl::StatusOr<Scene> scene = LoadText(file(k3mfTriangle));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(Lines(scene->warnings), ElementsAre("3D/3dmodel.model, line 6: another mesh in object 1, which may have "
                                                  "one; it is added"));
  const std::vector<Vec3f> corners = testing::CornersOf(*scene);
  ASSERT_EQ(corners.size(), 6u);
  EXPECT_EQ(corners[4], (Vec3f{40, 2, 30}));
  EXPECT_THAT(ErrorOf(file("<triangle v1=\"0\" v2=\"1\" v3=\"3\"/>")),
              HasSubstr("vertex 3 does not exist: object 1 has 3"));
}

TEST(ThreemfTest, RefusesMalformedModels) {
  const std::string place = "3MF: 3D/3dmodel.model, line ";
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, "<triangle v1=\"0\" v2=\"1\" v3=\"4\"/>"), k3mfItem)),
            place + "5: vertex 4 does not exist: object 1 has 4");
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, "<triangle v1=\"0\" v2=\"1\" v3=\"-1\"/>"), k3mfItem)),
            place + "5: v3='-1' is no index");
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, "<triangle v1=\"0\" v2=\"1\"/>"), k3mfItem)),
            place + "5: the attribute 'v3' is missing");
  EXPECT_EQ(ErrorOf(Model("<object id=\"1\"><mesh><vertices><vertex x=\"nan\" y=\"0\" z=\"0\"/>", "")),
            place + "4: x='nan' is not finite");
  EXPECT_EQ(ErrorOf(Model("<object id=\"1\"><mesh><vertices><vertex x=\"a\" y=\"0\" z=\"0\"/>", "")),
            place + "4: x='a' is no number");
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, k3mfTriangle), "<item objectid=\"2\"/>")), place + "7: object 2 does not exist");
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, k3mfTriangle), "<item objectid=\"1\" transform=\"1 2 3\"/>")),
            place + "7: transform: '' is no number");
  EXPECT_EQ(ErrorOf(Model(ObjectOf(1, k3mfTriangle), "<item objectid=\"1\" p:path=\"/a.model\"/>")),
            place + "7: the part '/a.model' does not exist");
  EXPECT_THAT(ErrorOf(Model("<a", "")), HasSubstr("3D/3dmodel.model, line"));
  EXPECT_THAT(ErrorOf(Package3mf("<html/>").Bytes()), HasSubstr("line 1: the first element is 'html', not 'model'"));
}

TEST(ThreemfTest, RefusesCyclesAndExplosions) {
  EXPECT_THAT(ErrorOf(Model("<object id=\"1\"><components><component objectid=\"2\"/></components></object>"
                            "<object id=\"2\"><components><component objectid=\"1\"/></components></object>",
                            k3mfItem)),
              HasSubstr("object 1 is a component of itself"));
  std::string doubling = ObjectOf(1, k3mfTriangle);
  for (int i = 2; i <= 60; ++i) {
    doubling += absl::StrCat("<object id=\"", i, "\"><components><component objectid=\"", i - 1,
                             "\"/><component objectid=\"", i - 1, "\"/></components></object>");
  }
  LoadLimits limits;
  limits.max_nodes = 10'000;
  EXPECT_THAT(ErrorOf(Model(doubling, "<item objectid=\"60\"/>"), MeshFormat::kAuto, limits),
              HasSubstr("more than 10000 items and components; the limit is max_nodes"));
  limits.max_node_depth = 20;
  EXPECT_THAT(ErrorOf(Model(doubling, "<item objectid=\"60\"/>"), MeshFormat::kAuto, limits),
              HasSubstr("more than 20 levels of components"));
}

TEST(ThreemfTest, RefusesXmlTricks) {
  const std::string bomb =
      "<?xml version=\"1.0\"?><!DOCTYPE model [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]><model>&b;</model>";
  EXPECT_EQ(ErrorOf(Package3mf(bomb).Bytes()), "3MF: 3D/3dmodel.model, line 1: a document type, which 3MF forbids");
  std::string deep;
  for (int i = 0; i < 1000; ++i) deep += "<x:a>";
  EXPECT_THAT(ErrorOf(Model(deep, "")), HasSubstr("more than 64 levels of elements"));
  // An attribute that needs memory without end.
  ZipMaker zip = Package3mf(absl::StrCat("<model unit=\"", std::string(40 << 20, 'a'), "\"/>"));
  std::string noise(1 << 20, '\0');
  for (size_t i = 0; i < noise.size(); ++i) noise[i] = char((i * 2654435761u) >> 13);
  zip.Add("Metadata/noise", noise, false);
  EXPECT_THAT(ErrorOf(zip.Bytes()), HasSubstr("an element needs more than 16777216 bytes"));
}

TEST(ThreemfTest, RefusesMalformedArchives) {
  const std::string good = Model(ObjectOf(1, k3mfTriangle), k3mfItem);
  EXPECT_EQ(ErrorOf(good), "");
  for (size_t cut = 1; cut < good.size(); cut += 7) {
    EXPECT_NE(ErrorOf(good.substr(0, cut), MeshFormat::k3mf), "") << cut;
  }
  ZipMaker bomb = Package3mf(absl::StrCat("<model>", std::string(8 << 20, ' '), "</model>"));
  EXPECT_THAT(ErrorOf(bomb.Bytes()), HasSubstr("bytes unpacked; all entries of a file of"));
  ZipMaker none;
  none.Add("[Content_Types].xml", "<Types/>");
  EXPECT_THAT(ErrorOf(none.Bytes()), HasSubstr("the ZIP archive has no 3D model"));
  std::string damaged = good;
  const size_t in_relationships = damaged.find("3D/3dmodel.model");
  damaged[damaged.find("3D/3dmodel.model", in_relationships + 1) + 40] ^= 0x55;
  EXPECT_THAT(ErrorOf(damaged), HasSubstr("3MF: "));
  ZipMaker twice = Package3mf("<model/>");
  twice.Add("3D/3dmodel.model", "<model/>");
  EXPECT_THAT(ErrorOf(twice.Bytes()), HasSubstr("a second entry '3D/3dmodel.model'"));
}

}  // namespace
}  // namespace voxelpipe
