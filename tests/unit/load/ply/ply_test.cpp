#include "load/ply/ply.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "shaders/texture/srgb.h"
#include "support/warnings.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using testing::Codes;
using testing::CornersOf;
using ::testing::ElementsAre;
using testing::ErrorOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::LoadText;

constexpr char kPlyXyz[] = "property float x\nproperty float y\nproperty float z\n";
constexpr char kPlyFaces[] = "property list uchar int vertex_indices\n";

std::string Ascii(const std::string& vertex, const std::string& face, const std::string& data) {
  return "ply\nformat ascii 1.0\ncomment made by a test\n" + vertex + face + "end_header\n" + data;
}

std::string PlySquare(const std::string& faces, const std::string& rows) {
  return Ascii(std::string("element vertex 4\n") + kPlyXyz, "element face " + faces + "\n" + kPlyFaces,
               "0 0 0\n1 0 0\n1 1 0\n0 1 0\n" + rows);
}

template <typename T>
void Put(std::string& bytes, T value, bool big) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof raw);
  if (big) std::reverse(raw, raw + sizeof raw);
  bytes.append(raw, sizeof raw);
}

TEST(PlyTest, ReadsAsciiPolygonsAsFans) {
  for (const char* rows : {"4 0 1 2 3\n3 0 1 3\n", "4 0 1\n2 3 3 0 1 3", "\r\n4 0 1 2 3\r\n3 0 1 3"}) {
    const absl::StatusOr<Scene> scene = LoadText(PlySquare("2", rows));
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->format, "ply");
    EXPECT_THAT(scene->meshes[0].primitives[0].triangles,
                ElementsAre(std::array<uint32_t, 3>{0, 1, 2}, std::array<uint32_t, 3>{0, 2, 3},
                            std::array<uint32_t, 3>{0, 1, 3}));
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  }
}

TEST(PlyTest, ReadsBothByteOrdersAndAllTypes) {
  for (const bool big : {false, true}) {
    std::string file = std::string("ply\r\nformat binary_") + (big ? "big" : "little") +
                       "_endian 1.0\r\nelement skipped 2\r\nproperty list ushort double values\r\n"
                       "element vertex 3\r\nproperty double x\r\nproperty int16 y\r\nproperty float32 z\r\n"
                       "property char weight\r\nelement face 1\r\nproperty uint8 flags\r\n"
                       "property list int32 uint vertex_index\r\nend_header\r\n";
    Put<uint16_t>(file, 2, big);
    Put<double>(file, 1, big);
    Put<double>(file, 2, big);
    Put<uint16_t>(file, 0, big);
    for (int v = 0; v < 3; ++v) {
      Put<double>(file, v == 1 ? 0.1 : 0, big);
      Put<int16_t>(file, int16_t(v == 2 ? -300 : 0), big);
      Put<float>(file, float(v), big);
      Put<int8_t>(file, int8_t(-v), big);
    }
    Put<uint8_t>(file, 9, big);
    Put<int32_t>(file, 3, big);
    for (const uint32_t index : {0u, 1u, 2u}) Put(file, index, big);
    const absl::StatusOr<Scene> scene = LoadText(file);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_THAT(CornersOf(*scene), ElementsAre(Vec3f{0, 0, 0}, Vec3f{0.1f, 0, 1}, Vec3f{0, -300, 2}));
    ASSERT_EQ(scene->meshes[0].primitives[0].attributes.size(), 1u);
    EXPECT_EQ(scene->meshes[0].primitives[0].attributes[0].name, "_weight");
    EXPECT_THAT(scene->meshes[0].primitives[0].attributes[0].values, ElementsAre(0, -1, -2));
    EXPECT_THAT(Codes(scene->warnings), ElementsAre("extension_ignored")) << "the element skipped";
    for (size_t cut = file.find("end_header") + 12; cut < file.size(); ++cut) {
      EXPECT_NE(ErrorOf(file.substr(0, cut)), "") << cut;
    }
  }
}

TEST(PlyTest, ColorsAreLinearAndUvTurned) {
  const std::string text =
      Ascii(std::string("element vertex 3\n") + kPlyXyz +
                "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                "property float nx\nproperty float ny\nproperty float nz\n"
                "property float s\nproperty float t\n",
            std::string("element face 1\n") + kPlyFaces,
            "0 0 0 255 128 0 0 0 1 0.25 0\n1 0 0 0 0 0 0 0 1 0 1\n0 1 0 0 0 0 0 0 1 0 0\n3 0 1 2\n");
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives[0];
  EXPECT_EQ(primitive.colors[0], (Vec4f{1, SrgbToLinear(128), 0, 1}));
  EXPECT_EQ(primitive.normals[2], (Vec3f{0, 0, 1}));
  EXPECT_EQ(primitive.uv[0][0], (Vec2f{0.25f, 1}));
  EXPECT_EQ(primitive.uv[0][1], (Vec2f{0, 0}));
}

TEST(PlyTest, AlphaAndFloatColors) {
  const std::string text =
      Ascii(std::string("element vertex 1\n") + kPlyXyz +
                "property float red\nproperty float green\nproperty float blue\nproperty float alpha\n",
            "", "0 0 0 1 0.5 0 0.25\n");
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives[0];
  EXPECT_NEAR(primitive.colors[0].y, 0.21404114, 1e-5) << "between two codes";
  EXPECT_EQ(primitive.colors[0].w, 0.25f);
  EXPECT_TRUE(primitive.points_or_lines) << "a cloud of points";
}

TEST(PlyTest, ReadsStripsOfTriangles) {
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\n"
      "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
  std::string vertices;
  for (int i = 0; i < 9; ++i) vertices += std::to_string(i) + " 0 0\n";
  const absl::StatusOr<Scene> scene = LoadText(head + vertices + "10 0 1 2 3 4 5 -1 6 7 8\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  using Triangle = std::array<uint32_t, 3>;
  EXPECT_THAT(
      scene->meshes[0].primitives[0].triangles,
      ElementsAre(Triangle{0, 1, 2}, Triangle{1, 3, 2}, Triangle{2, 3, 4}, Triangle{3, 5, 4}, Triangle{6, 7, 8}));
  EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  EXPECT_FALSE(scene->meshes[0].primitives[0].points_or_lines);
  EXPECT_THAT(ErrorOf(head + vertices + "3 0 1 -2\n"), HasSubstr("tristrips 0: vertex -2 does not exist"));
  EXPECT_THAT(ErrorOf(head + vertices + "3 0 1 9\n"), HasSubstr("tristrips 0: vertex 9 does not exist"));
}

// Without its vertices it is not known which triangles a polygon has.
TEST(PlyTest, ConcaveFacesMayComeBeforeVertices) {
  const absl::StatusOr<Scene> scene = LoadText(
      "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\nelement vertex 4\n"
      "property float x\nproperty float y\nproperty float z\nend_header\n3 0 1 2\n4 1 2 3 0\n"
      "0 0 0\n4 -3 0\n2 0 0\n4 3 0\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  double area = 0;
  const std::vector<Vec3f> corners = testing::CornersOf(*scene);
  ASSERT_EQ(corners.size(), 9u);
  for (size_t t = 0; t < 9; t += 3) area += Cross(corners[t + 1] - corners[t], corners[t + 2] - corners[t]).z / 2;
  EXPECT_EQ(area, 3 + 6);
}

TEST(PlyTest, RefusesMalformedHeaders) {
  EXPECT_EQ(ErrorOf("plyx\n", MeshFormat::kPly), "PLY: line 1: a PLY file begins with 'ply'");
  EXPECT_EQ(ErrorOf("ply\nformat ascii 1.0\n"), "PLY: line 2: the header has no 'end_header'; the file may be cut off");
  EXPECT_EQ(ErrorOf("ply\nend_header\n"), "PLY: line 2: the header has no 'format'");
  EXPECT_THAT(ErrorOf("ply\nformat xml 1.0\n"), HasSubstr("line 2: the format 'xml' is none of ascii"));
  EXPECT_THAT(ErrorOf("ply\nelement vertex -1\n"), HasSubstr("line 2: an element has a name and a number"));
  EXPECT_THAT(ErrorOf("ply\nelement vertex 99999999999999999999\n"), HasSubstr("line 2: an element has a name"));
  EXPECT_THAT(ErrorOf("ply\nproperty float x\n"), HasSubstr("line 2: a property before the first element"));
  EXPECT_THAT(ErrorOf("ply\nelement vertex 1\nproperty half x\n"), HasSubstr("line 3: 'half' is no type"));
  EXPECT_THAT(ErrorOf("ply\nelement vertex 1\nproperty list float int x\n"),
              HasSubstr("line 3: 'float' is no type of integers for the length of a list"));
  EXPECT_THAT(ErrorOf("ply\nelement vertex 1\nelement vertex 1\n"), HasSubstr("line 3: a second element 'vertex'"));
  EXPECT_THAT(ErrorOf("ply\nelement a 1\nproperty int x\nproperty int x\n"), HasSubstr("line 4: a second property"));
  EXPECT_THAT(ErrorOf("ply\nvertex 1\n"), HasSubstr("line 2: 'vertex' is no statement of a header"));
}

TEST(PlyTest, CountsMustFitIntoTheFile) {
  for (const char* count : {"100", "9223372036854775807"}) {
    EXPECT_THAT(ErrorOf(Ascii(std::string("element vertex ") + count + "\n" + kPlyXyz, "", "0 0 0\n")),
                HasSubstr("of the element 'vertex' do not fit into the rest of the file"));
    EXPECT_THAT(ErrorOf(PlySquare(count, "3 0 1 2\n")), HasSubstr("of the element 'face' do not fit"));
  }
  // Without properties an element has no bytes.
  EXPECT_EQ(ErrorOf(Ascii("element nothing 9223372036854775807\n", "", "")), "");
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list int int vertex_indices\n"
      "end_header\n";
  for (const int32_t count : {-1, 5, 0x7fffffff}) {
    std::string with = file;
    Put<int32_t>(with, count, false);
    Put<int32_t>(with, 0, false);
    EXPECT_THAT(ErrorOf(with), HasSubstr("face 0, property 'vertex_indices': a list of"));
  }
}

TEST(PlyTest, RefusesMalformedData) {
  EXPECT_EQ(ErrorOf(PlySquare("1", "3 0 1 4\n")), "PLY: face 0: vertex 4 does not exist: there are 4");
  EXPECT_EQ(ErrorOf(PlySquare("1", "3 0 1 -1\n")), "PLY: face 0: vertex -1 does not exist: there are 4");
  EXPECT_EQ(ErrorOf(PlySquare("1", "3 0 1\n")), "PLY: face 0, property 'vertex_indices': the file ends");
  EXPECT_EQ(ErrorOf(PlySquare("1", "3 0 one 2\n")),
            "PLY: face 0, property 'vertex_indices': line 15: 'one' is no number of its type");
  EXPECT_THAT(ErrorOf(PlySquare("1", "7 0 1 2\n")), HasSubstr("a list of 7 values does not fit"));
  const std::string vertex = std::string("element vertex 1\n") + kPlyXyz;
  EXPECT_EQ(ErrorOf(Ascii(vertex, "", "0 nan 0\n")), "PLY: vertex 0 is not finite");
  EXPECT_EQ(ErrorOf(Ascii(vertex, "", "0 inf 0\n")), "PLY: vertex 0 is not finite");
  EXPECT_EQ(ErrorOf(Ascii("element vertex 1\nproperty float x\n", "", "0\n")),
            "PLY: line 4: the element vertex lacks x, y or z");
  EXPECT_EQ(ErrorOf(Ascii(vertex, "element face 1\nproperty int a\n", "0 0 0\n1\n")),
            "PLY: line 8: the element face lacks the list vertex_indices");
}

TEST(PlyTest, FacesOfFewCornersAndColorsOfFacesGiveWarnings) {
  const absl::StatusOr<Scene> few = LoadText(PlySquare("3", "2 0 1\n0\n3 0 1 2\n"));
  ASSERT_TRUE(few.ok()) << few.status();
  EXPECT_EQ(few->meshes[0].primitives[0].triangles.size(), 1u);
  EXPECT_THAT(testing::Lines(few->warnings), ElementsAre("face: 2 faces of fewer than three corners are ignored"));
  const std::string text =
      Ascii(std::string("element vertex 3\n") + kPlyXyz,
            std::string("element face 1\n") + kPlyFaces + "property uchar red\n", "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255\n");
  const absl::StatusOr<Scene> colors = LoadText(text);
  ASSERT_TRUE(colors.ok()) << colors.status();
  EXPECT_THAT(testing::Lines(colors->warnings), ElementsAre("face: the property 'red' of faces is ignored"));
}

// A header that lacks a property leaves bytes behind, and what was read before them is something else.
TEST(PlyTest, DataThatNoElementTakesGivesAWarning) {
  const absl::StatusOr<Scene> text = LoadText(PlySquare("1", "3 0 1 2\n3 0 2 3\n"));
  ASSERT_TRUE(text.ok()) << text.status();
  EXPECT_THAT(
      testing::Lines(text->warnings),
      ElementsAre("the lines from 16 on belong to no element and are ignored; the header may not fit the data"));
  std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n" + std::string(kPlyXyz) +
                     "element face 1\n" + kPlyFaces + "end_header\n";
  for (const float value : {0, 0, 0, 1, 0, 0, 0, 1, 0}) Put(file, value, false);
  Put(file, uint8_t{3}, false);
  for (const int index : {0, 1, 2}) Put(file, index, false);
  EXPECT_THAT(LoadText(file)->warnings.kept(), IsEmpty());
  EXPECT_THAT(testing::Lines(LoadText(file + std::string(5, 'x'))->warnings),
              ElementsAre("the last 5 bytes belong to no element and are ignored; the header may not fit the data"));
}

TEST(PlyTest, FacesMayComeBeforeVertices) {
  const std::string text = "ply\nformat ascii 1.0\nelement face 1\n" + std::string(kPlyFaces) + "element vertex 3\n" +
                           kPlyXyz + "end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0";
  EXPECT_EQ(ErrorOf(text), "");
}

}  // namespace
}  // namespace voxelpipe
