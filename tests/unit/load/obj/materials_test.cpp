// Material libraries and textures: as data: URIs in the loader, as files in the packer.
#include "load/obj/materials.h"

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/load_mesh.h"
#include "load/pack.h"
#include "load/pack_obj.h"
#include "mesh/flatten.h"
#include "mesh/texture_faults.h"
#include "shaders/texture/srgb.h"
#include "support/meshes/glb_builder.h"
#include "support/resources/temporary_directory.h"
#include "support/warnings.h"
#include "unit/load/charged_packing.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using testing::ErrorOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::Lines;
using testing::LoadText;

constexpr char kQuad[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
constexpr char kFace[] = "f 1/1 2/2 3/3 4/4\n";

std::string Png() {
  const testing::ByteVector bytes = testing::MakePng(1, 1, {255, 0, 0, 255});
  return {bytes.begin(), bytes.end()};
}

std::string PngUri(const std::string& name = "") {
  const std::string png = Png();
  return "data:image/png" + (name.empty() ? "" : ";name=" + name) + ";base64," +
         testing::Base64({reinterpret_cast<const uint8_t*>(png.data()), png.size()});
}

std::string Library(const std::string& text) {
  return "mtllib data:model/mtl;base64," +
         testing::Base64({reinterpret_cast<const uint8_t*>(text.data()), text.size()}) + "\n";
}

TEST(ObjMaterialTest, ReadsALibrary) {
  const std::string library =
      "# a comment\r\nnewmtl red paint\r\nKd 1 0.501960784 0\r\nd 0.25\nKe 0 0 1\nPm 0.5\nPr 0.75\nNs 10\nillum 2\n"
      "newmtl wood\n\tmap_Kd -clamp on -s 2 4 1 -o 0.25 0.5 " +
      PngUri() + "\nTr 0.5\n";
  const absl::StatusOr<Scene> scene =
      LoadText(Library(library) + kQuad + "usemtl wood\n" + kFace + "usemtl red paint\n" + kFace);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  ASSERT_EQ(scene->materials.size(), 2u);
  const Material& red = scene->materials[0];
  EXPECT_EQ(red.name, "red paint");
  EXPECT_EQ(red.base_color_factor, (Vec4f{1, SrgbToLinear(128), 0, 0.25f}));
  EXPECT_EQ(red.emissive_factor, (Vec3f{0, 0, 1}));
  EXPECT_EQ(red.metallic_factor, 0.5f);
  EXPECT_EQ(red.roughness_factor, 0.75f);
  EXPECT_EQ(red.alpha_mode, AlphaMode::kBlend);
  const Material& wood = scene->materials[1];
  EXPECT_EQ(wood.base_color_factor.w, 0.5f);
  EXPECT_EQ(wood.metallic_factor, 0);
  ASSERT_EQ(wood.base_color.texture, 0);
  EXPECT_EQ(wood.base_color.scale[1], 4);
  EXPECT_EQ(wood.base_color.offset[0], 0.25f);
  EXPECT_EQ(wood.base_color.offset[1], 1 - 0.5f - 4);
  EXPECT_EQ(scene->textures[0].wrap_s, WrapMode::kClampToEdge);
  EXPECT_EQ(scene->images[0]->mime_type, "image/png");
  EXPECT_THAT(scene->meshes[0].primitives, ::testing::SizeIs(2));
  EXPECT_EQ(scene->meshes[0].primitives[0].material, 1);
}

TEST(ObjMaterialTest, ATextureIsNamedAfterItsFirstUse) {
  const absl::StatusOr<Scene> scene =
      LoadText(Library("newmtl a\nmap_Kd " + PngUri("the%20wood.png") + "\nnewmtl b\nmap_Kd the wood.png\n") + kQuad);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->images.size(), 1u);
  EXPECT_EQ(scene->textures[size_t(scene->materials[1].base_color.texture)].image, 0);
}

TEST(ObjMaterialTest, MissingFilesGiveWarnings) {
  const absl::StatusOr<Scene> scene =
      LoadText(std::string("mtllib my things.mtl\n") + kQuad + "usemtl a\n" + kFace + "usemtl b\n" + kFace);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(Lines(scene->warnings), ElementsAre("line 1: the material library 'my things.mtl' is no file that could "
                                                  "be read; materials have their defaults"));
  EXPECT_EQ(scene->materials.size(), 2u) << "each its own, for the shader material_id";
  for (const char* name : {"../../etc/passwd", "http://example.org/a.mtl", "/etc/passwd"}) {
    EXPECT_THAT(testing::Codes(LoadText(absl::StrCat("mtllib ", name, "\n", kQuad))->warnings),
                ElementsAre("texture_missing"))
        << name;
  }
  const absl::StatusOr<Scene> textures =
      LoadText(Library("newmtl a\nmap_Kd wood.png\n") + kQuad + "usemtl a\n" + kFace);
  ASSERT_TRUE(textures.ok()) << textures.status();
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*textures, {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  WarningList warnings;
  AddTextureWarnings(*mesh, {true, true, true}, warnings);
  EXPECT_THAT(Lines(warnings), ElementsAre("material 0: base colour texture: the file 'wood.png' could not be read; "
                                           "the material's factor is used"));
}

TEST(ObjMaterialTest, FaultsInALibraryGiveWarnings) {
  const absl::StatusOr<Scene> scene =
      LoadText(Library("Kd 1 1 1\nnewmtl a\nKd 1 x 1\nd\nmap_d a.png\nmap_Kd data:image/png;base64,!!\n") + kQuad +
               "usemtl b\n" + kFace);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(Lines(scene->warnings),
              ElementsAre("the library of line 1, line 1: a statement before the first 'newmtl' is ignored",
                          "the library of line 1, line 3: 'Kd' needs 3 numbers; it is ignored",
                          "the library of line 1, line 4: 'd' needs 1 number; it is ignored",
                          "the library of line 1, line 5: the texture of the opacity (map_d) is ignored",
                          "line 10: no material library has the material 'b'; it has the defaults"));
  EXPECT_THAT(scene->materials[0].base_color.fault, HasSubstr("not base64"));
  EXPECT_THAT(ErrorOf(std::string("mtllib data:;base64,!!\n") + kQuad), HasSubstr("OBJ: line 1: the material library"));
}

class PackObjTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Write("model/parts/all.mtl",
          "newmtl a\nmap_Kd -s 1 1 1 my wood.png\nnewmtl b\nmap_Kd my wood.png\nmap_Ke .\\my wood.png");
    Write("model/parts/my wood.png", Png());
    Write("elsewhere.mtl", "newmtl a\nKd 1 0 0\n");
  }
  void Write(const std::string& name, const std::string& text) {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name, std::ios::binary) << text;
  }
  std::string Pack(const std::string& text, const OutsideFiles& outside = {}) {
    Write("model/a.obj", text);
    const auto packed = ReadAndPackMeshFile((root_ / "model/a.obj").string(), {}, nullptr, outside);
    return packed.ok() ? std::string(packed->bytes.begin(), packed->bytes.end())
                       : std::string(packed.status().message());
  }
  const testing::TemporaryDirectory directory_;
  const fs::path root_ = directory_.path();
};

TEST_F(PackObjTest, PutsLibrariesAndTexturesIn) {
  for (const char* name : {"parts/all.mtl", "parts\\all.mtl"}) {
    const std::string packed =
        Pack(absl::StrCat("mtllib ", name, "\r\n", kQuad, "usemtl a\n", kFace, "usemtl b\n", kFace));
    const absl::StatusOr<Scene> scene = LoadText(packed);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
    ASSERT_EQ(scene->images.size(), 1u) << "once for three uses";
    EXPECT_EQ(std::string(scene->images[0]->encoded.begin(), scene->images[0]->encoded.end()), Png());
    EXPECT_GE(scene->materials[1].emissive.texture, 0);
    EXPECT_EQ(packed.substr(packed.size() - 40), absl::StrCat(kFace, "usemtl b\n", kFace).substr(5));
  }
}

// A few bytes of a file could name a library thousands of times, and each was read and packed.
TEST_F(PackObjTest, ALibraryIsPackedOnceHoweverOftenItIsNamed) {
  Write("model/b.mtl", "newmtl other\n");
  std::string text;
  for (int i = 0; i < 200; ++i) text += i % 2 == 0 ? "mtllib parts/all.mtl\n" : "mtllib b.mtl ./parts/all.mtl\n";
  const std::string packed = Pack(text + kQuad + "usemtl a\n" + kFace);
  EXPECT_EQ(std::count(packed.begin(), packed.end(), '\n'), 200 + 8 + 1 + 1);
  size_t libraries = 0;
  for (size_t at = packed.find("data:model/mtl"); at != std::string::npos; at = packed.find("data:model/mtl", at + 1)) {
    ++libraries;
  }
  EXPECT_EQ(libraries, 2u);
  EXPECT_THAT(packed, HasSubstr("\nmtllib\nmtllib\n"));
  const absl::StatusOr<Scene> scene = LoadText(packed);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  EXPECT_EQ(scene->materials.size(), 3u);
  EXPECT_EQ(scene->images.size(), 1u);
}

TEST_F(PackObjTest, FilesThatAreNamedAreChargedAndTheJobIsPolled) {
  Write("model/big.mtl", std::string((1 << 20) + 1, '#'));
  testing::ExpectPackingIsChargedAndPolled(std::string("mtllib big.mtl\n") + kQuad, root_ / "model");
}

TEST_F(PackObjTest, SeveralLibrariesInOneStatement) {
  Write("model/b.mtl", "newmtl other\n");
  const absl::StatusOr<Scene> scene = LoadText(Pack(std::string("mtllib parts/all.mtl missing.mtl b.mtl\n") + kQuad));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(testing::Codes(scene->warnings), std::vector<std::string>{"texture_missing"});
  EXPECT_EQ(scene->materials.back().name, "other");
}

TEST_F(PackObjTest, FilesOutsideAreRefusedUnlessAllowed) {
  const std::string text = std::string("mtllib ../elsewhere.mtl\n") + kQuad;
  EXPECT_THAT(Pack(text), HasSubstr("line 1: the file '../elsewhere.mtl' leaves the directory of the OBJ file"));
  EXPECT_THAT(Pack(text), HasSubstr("(--allow-outside)"));
  EXPECT_THAT(Pack(text, {true, {true, true, true}}), HasSubstr("data:model/mtl"));
  EXPECT_EQ(Pack(text, {false, {}}), text) << "no shader reads materials";
  fs::create_symlink(root_ / "elsewhere.mtl", root_ / "model/link.mtl");
  EXPECT_THAT(Pack("mtllib link.mtl\n"), HasSubstr("link.mtl' leads out of the directory of the OBJ file"));
  for (const char* name : {"/etc/passwd", "C:\\all.mtl", "../missing.mtl", "http://example.org/all.mtl"}) {
    const std::string stays = absl::StrCat("mtllib ", name, "\n", kQuad);
    EXPECT_EQ(Pack(stays), stays) << name;
  }
}

TEST_F(PackObjTest, AFileWithoutLibrariesStaysAsItIs) {
  const std::string text = absl::StrCat("# mtllib\n", kQuad, kFace);
  EXPECT_EQ(Pack(text), text);
}

}  // namespace
}  // namespace voxelpipe
