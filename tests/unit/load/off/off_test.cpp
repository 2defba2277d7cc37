#include "load/off/off.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "shaders/texture/srgb.h"
#include "support/warnings.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using testing::Codes;
using ::testing::ElementsAre;
using testing::ErrorOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::LoadText;

constexpr char kOffSquare[] = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

TEST(OffTest, ReadsPolygonsAsFans) {
  for (const std::string head : {"OFF\n4 1 0\n", "OFF 4 1 0\n", "OFF4 1 0\n",
                                 "# first\n\nOFF # the keyword\r\n# counts\r\n4 1\n", "OFF\r4 1 4\r"}) {
    const absl::StatusOr<Scene> scene = LoadText(head + kOffSquare);
    ASSERT_TRUE(scene.ok()) << head << scene.status();
    EXPECT_EQ(scene->format, "off");
    EXPECT_THAT(scene->meshes[0].primitives[0].triangles,
                ElementsAre(std::array<uint32_t, 3>{0, 1, 2}, std::array<uint32_t, 3>{0, 2, 3}));
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  }
  EXPECT_TRUE(LoadText(std::string("4 1 0\n") + kOffSquare, MeshFormat::kOff).ok()) << "the keyword may be missing";
}

TEST(OffTest, ReadsColorsNormalsAndUv) {
  const absl::StatusOr<Scene> scene = LoadText(
      "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 128 0 0.25 0\n1 0 0 0 0 1 51 0 0 51 0 0\n0 1 0 0 0 1 0 0 0 0 0\n3 0 1 2");
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives[0];
  EXPECT_EQ(primitive.normals[0], (Vec3f{0, 0, 1}));
  EXPECT_EQ(primitive.colors[0], (Vec4f{1, SrgbToLinear(128), 0, 1}));
  EXPECT_EQ(primitive.colors[1].w, 0.2f);
  EXPECT_EQ(primitive.uv[0][0], (Vec2f{0.25f, 1}));
}

// A colour of ones without a point is white if other colours are fractions.
TEST(OffTest, ColorsAreFractionsOrCodesInAWholeFile) {
  const absl::StatusOr<Scene> fractions =
      LoadText("COFF\n3 1 0\n0 0 0 1 1 1 1\n1 0 0 0.2 0.4 0.6 1\n0 1 0 1 0 0 1\n3 0 1 2\n");
  ASSERT_TRUE(fractions.ok()) << fractions.status();
  const Primitive& primitive = fractions->meshes[0].primitives[0];
  EXPECT_EQ(primitive.colors[0], (Vec4f{1, 1, 1, 1}));
  EXPECT_EQ(primitive.colors[1].x, SrgbToLinear(51));
  EXPECT_EQ(primitive.colors[2], (Vec4f{1, 0, 0, 1}));
  EXPECT_NEAR(LoadText("COFF\n1 0 0\n0 0 0 0.5 0 0\n")->meshes[0].primitives[0].colors[0].x, 0.21404114, 1e-5);
  EXPECT_EQ(LoadText("COFF\n1 0 0\n0 0 0 51.0 0 0\n")->meshes[0].primitives[0].colors[0].x, SrgbToLinear(51));
  const absl::StatusOr<Scene> codes = LoadText("COFF\n3 1 0\n0 0 0 1 1 1\n1 0 0 255 0 0\n0 1 0 0 0 255\n3 0 1 2\n");
  ASSERT_TRUE(codes.ok()) << codes.status();
  EXPECT_EQ(codes->meshes[0].primitives[0].colors[0], (Vec4f{SrgbToLinear(1), SrgbToLinear(1), SrgbToLinear(1), 1}));
}

TEST(OffTest, LinesMayEndAnywhereBeforeTheEndOfAFace) {
  for (const std::string text :
       {"OFF\n4\n1\n0\n0 0\n0  1 0 0\n1 1 0 0 1 0\n4 0 1\n2 3\n", "OFF 4\n1 0 0 0 0 1 0 0\n1 1 0 0 1 0\n4 0 1 2\n3",
        "OFF\n4 1\n0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        "OFF\n4 1 0\n0 0 0 1 0 0\n1 1 0 0 1 0\n4\n0\n1\n2\n3\n"}) {
    const absl::StatusOr<Scene> scene = LoadText(text);
    ASSERT_TRUE(scene.ok()) << text << scene.status();
    EXPECT_THAT(testing::CornersOf(*scene), ElementsAre(Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{1, 1, 0}, Vec3f{0, 0, 0},
                                                        Vec3f{1, 1, 0}, Vec3f{0, 1, 0}))
        << text;
    EXPECT_THAT(scene->warnings.kept(), IsEmpty()) << text;
  }
  const absl::StatusOr<Scene> colors =
      LoadText("COFF\n3 1 0\n0 0 0\n255 0 0 255\n1 0 0\n0 255 0 255 0 1 0\n0 0 0 0\n3 0 1 2 9 9 9");
  ASSERT_TRUE(colors.ok()) << colors.status();
  EXPECT_EQ(colors->meshes[0].primitives[0].colors[1], (Vec4f{0, 1, 0, 1}));
}

TEST(OffTest, WarnsOfWhatItIgnores) {
  const std::string vertices = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_THAT(testing::Lines(LoadText(vertices + "3 0 1 2 255 0 0\n")->warnings),
              ElementsAre("faces: colours of faces are ignored"));
  EXPECT_THAT(Codes(LoadText(vertices + "3 0 1 2\n3 0 1 2\n")->warnings), ElementsAre("count_mismatch"));
  EXPECT_THAT(Codes(LoadText(vertices + "2 0 1\n")->warnings), ElementsAre("nonconforming_file"));
  EXPECT_THAT(Codes(LoadText("OFF\n1 0 0\n0 0 0 1\n")->warnings), ElementsAre("nonconforming_file"));
}

TEST(OffTest, RefusesMalformedFiles) {
  const std::string vertices = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_EQ(ErrorOf(vertices + "3 0 1 3\n"), "OFF: line 6: vertex 3 does not exist: there are 3");
  EXPECT_EQ(ErrorOf(vertices + "3 0 1 -1\n"), "OFF: line 6: vertex -1 does not exist: there are 3");
  EXPECT_EQ(ErrorOf(vertices + "3 0 1 1.5\n"), "OFF: line 6: corner 2 of the face: '1.5' is no index");
  EXPECT_EQ(ErrorOf(vertices + "9999999999 0 1 2\n"),
            "OFF: line 6: a face of 9999999999 corners does not fit into the file; it may be cut off");
  EXPECT_EQ(ErrorOf(vertices + "-3 0 1 2\n"), "OFF: line 6: the number of corners of a face, not '-3'");
  EXPECT_THAT(ErrorOf("OFF\n3 1 0\n0 0 0\n1 0 0\n0 0 0   "), HasSubstr("the file ends behind 0 of 1 faces"));
  EXPECT_THAT(ErrorOf("OFF\n3 0 0\n0 0 0\n1 0 0\n#########"), HasSubstr("the file ends behind 2 of 3 vertices"));
  EXPECT_EQ(ErrorOf("OFF\n1 0 0\n0 0 inf\n"), "OFF: line 3: the vertex is not finite");
  EXPECT_EQ(ErrorOf("OFF\n1 0 0\n0 zero 0\n"), "OFF: line 3: a vertex: 'zero' is no number");
  EXPECT_EQ(ErrorOf("OFF\n1 0 0\n0 0 #  0\n"), "OFF: line 3: a vertex is incomplete");
  EXPECT_THAT(ErrorOf("OFF\n9999999 1 0\n0 0 0\n"), HasSubstr("line 2: 9999999 vertices and 1 faces do not fit"));
  EXPECT_THAT(ErrorOf("OFF\n1 9223372036854775807 0\n0 0 0\n"), HasSubstr("faces do not fit into the file"));
  EXPECT_THAT(ErrorOf("OFF\n-1 1 0\n"), HasSubstr("the counts of vertices and faces are expected"));
  EXPECT_THAT(ErrorOf("OFF\n"), HasSubstr("the counts of vertices and faces are missing"));
  EXPECT_THAT(ErrorOf("4OFF\n1 1 1\n"), HasSubstr("only vertices of three dimensions"));
  EXPECT_THAT(ErrorOf("OFF BINARY\n"), HasSubstr("binary OFF is not read"));
}

}  // namespace
}  // namespace voxelpipe
