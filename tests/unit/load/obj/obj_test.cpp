#include "load/obj/obj.h"

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
using testing::Lines;
using testing::LoadText;

constexpr char kObjSquare[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST(ObjTest, ReadsPolygonsAsFansWithSharedVertices) {
  for (const char* faces :
       {"f 1 2 3 4\n", "f -4 -3 -2 -1", "f 1 2 \\\n3 4\r\n", "f +1 2 3 4 # a comment\n", "fo 1 2 3 4\n"}) {
    const absl::StatusOr<Scene> scene = LoadText(std::string("# made by a test\r\n\n") + kObjSquare + faces);
    ASSERT_TRUE(scene.ok()) << faces << scene.status();
    EXPECT_EQ(scene->format, "obj");
    ASSERT_EQ(scene->meshes[0].primitives.size(), 1u);
    EXPECT_EQ(scene->meshes[0].primitives[0].positions.size(), 4u);
    EXPECT_THAT(CornersOf(*scene), ElementsAre(Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{1, 1, 0}, Vec3f{0, 0, 0},
                                               Vec3f{1, 1, 0}, Vec3f{0, 1, 0}));
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  }
}

TEST(ObjTest, CornersCombineTheirLists) {
  const std::string text = std::string(kObjSquare) +
                           "vt 0 0\nvt 1 0.25 0\nvt .5\nvn 0 0 1\nvn 0 1 0\n"
                           "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/1/1\nf 1/1/2 2/2/1 3/3/1\n";
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives.at(0);
  EXPECT_EQ(primitive.positions.size(), 5u) << "corner 1 has two normals";
  EXPECT_EQ(primitive.uv[0][1], (Vec2f{1, 0.75f}));
  EXPECT_EQ(primitive.uv[0][2], (Vec2f{0.5f, 1}));
  EXPECT_EQ(primitive.normals[primitive.triangles[2][0]], (Vec3f{0, 1, 0}));
}

TEST(ObjTest, KindsOfCornersAndMaterialsBeginPrimitives) {
  const std::string text = std::string(kObjSquare) +
                           "vt 0 0\nvn 0 0 1\nf 1 2 3\nf 1//1 2//1 3//-1\nf 1/1 2/1 3/-1\nusemtl a\nf 1/1 2/1/ 3/1\n"
                           "usemtl b\nf 1 2 3\nusemtl a\nf 1 2 4\n";
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const std::vector<Primitive>& primitives = scene->meshes[0].primitives;
  ASSERT_EQ(primitives.size(), 6u);
  std::vector<int> materials;
  for (const Primitive& primitive : primitives) materials.push_back(primitive.material);
  EXPECT_THAT(materials, ElementsAre(-1, -1, -1, 0, 1, 0));
  EXPECT_FALSE(primitives[1].normals.empty());
  EXPECT_FALSE(primitives[2].uv[0].empty());
  EXPECT_EQ(scene->materials[1].name, "b");
  EXPECT_EQ(CornersOf(*scene).back(), (Vec3f{0, 1, 0})) << "the order of the file";
}

TEST(ObjTest, ReadsVertexColors) {
  const absl::StatusOr<Scene> scene = LoadText("v 0 0 0 1\nv 1 0 0 0.5019607843 0 1\nv 0 1 0 0 0 0\nf 1 2 3\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives[0];
  EXPECT_THAT(primitive.colors, ElementsAre(Vec4f{1, 1, 1, 1}, Vec4f{SrgbToLinear(128), 0, 1, 1}, Vec4f{0, 0, 0, 1}));
}

TEST(ObjTest, RefusesMalformedFaces) {
  const std::string head = std::string(kObjSquare) + "vt 0 0\n";
  EXPECT_EQ(ErrorOf(head + "f 0 1 2\n"),
            "OBJ: line 6: index 0 of a vertex; they count from 1, or with negative numbers back from the last one");
  EXPECT_EQ(ErrorOf(head + "f 1 2 5\n"), "OBJ: line 6: vertex 5 does not exist: there are 4 above this line");
  EXPECT_EQ(ErrorOf(head + "f 1 2 -5\n"), "OBJ: line 6: vertex -5 does not exist: there are 4 above this line");
  EXPECT_EQ(ErrorOf(head + "f 1 2 -9223372036854775808\n"),
            "OBJ: line 6: vertex -9223372036854775808 does not exist: there are 4 above this line");
  EXPECT_EQ(ErrorOf(head + "f 1 2 9223372036854775808\n"),
            "OBJ: line 6: the index of a vertex is expected at '9223372036854775808'");
  EXPECT_EQ(ErrorOf(head + "f 1/2 2 3\n"),
            "OBJ: line 6: texture coordinate 2 does not exist: there are 1 above this line");
  EXPECT_EQ(ErrorOf(head + "f 1//1 2 3\n"), "OBJ: line 6: normal 1 does not exist: there are 0 above this line");
  EXPECT_THAT(ErrorOf(head + "f 1 2 x\n"), HasSubstr("line 6: the index of a vertex is expected at 'x'"));
  EXPECT_THAT(ErrorOf(head + "f 1 2 3.5\n"), HasSubstr("line 6: '3.5' is no corner of a face"));
  EXPECT_THAT(ErrorOf(head + "f 1 2 3/1/1/1\n"), HasSubstr("line 6"));
  EXPECT_THAT(ErrorOf(head + "\\\n\\\nf 1 2 7\n"), HasSubstr("line 6")) << "the first of the lines";
}

TEST(ObjTest, RefusesMalformedVertices) {
  EXPECT_EQ(ErrorOf("v 0 0\n"), "OBJ: line 1: a vertex has three coordinates, not 2");
  EXPECT_EQ(ErrorOf("v 0 0 zero\n"), "OBJ: line 1: a vertex: 'zero' is no number");
  EXPECT_EQ(ErrorOf("v 0 0 nan\n"), "OBJ: line 1: the vertex is not finite");
  EXPECT_EQ(ErrorOf("v 0 0 1e39\n"), "OBJ: line 1: the vertex is not finite");
  EXPECT_EQ(ErrorOf("\xEF\xBB\xBFv 0 0 0\rv 0 x 0"), "OBJ: line 2: a vertex: 'x' is no number");
  EXPECT_EQ(ErrorOf("vn 0 0\n"), "OBJ: line 1: a normal has three numbers, not 2");
  EXPECT_EQ(ErrorOf("vt\n"), "OBJ: line 1: a texture coordinate has one number at least");
  EXPECT_EQ(ErrorOf("nothing\n", MeshFormat::kObj), "OBJ: no line is a statement of OBJ (v, f, ...)");
  LoadLimits limits;
  limits.max_vertices = 3;
  EXPECT_THAT(ErrorOf(kObjSquare, MeshFormat::kObj, limits), HasSubstr("4 vertices; the limit max_vertices is 3"));
  limits = {};
  limits.max_triangles = 1;
  EXPECT_THAT(ErrorOf(std::string(kObjSquare) + "f 1 2 3 4\n", MeshFormat::kObj, limits),
              HasSubstr("2 triangles; the limit max_triangles is 1"));
}

TEST(ObjTest, TinyNumbersAreZero) {
  const absl::StatusOr<Scene> scene = LoadText("v 1e-60 -1e-400 1e-30\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(CornersOf(*scene)[0], (Vec3f{0, 0, 1e-30f}));
}

TEST(ObjTest, WarnsOfWhatItIgnores) {
  const absl::StatusOr<Scene> scene = LoadText(std::string(kObjSquare) +
                                               "vt nan 0\ncurv 0 1 1 2\nsurf 0 1\nbogus\nbogus2\nf 1 2\nf 1/1 2 3\n"
                                               "v 0 0 0 255 0 0\nl 1 2\np 1\ng x\ns off\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(
      Lines(scene->warnings),
      ElementsAre(
          "line 6: 'curv' and what it is part of is ignored", "line 8: 'bogus' is no statement of OBJ; it is ignored",
          "line 12: a colour beyond 1; it is 1 here and below", "1 faces of fewer than three corners are ignored",
          "faces of which only some corners have texture coordinates or normals; they count as without"));
}

TEST(ObjTest, PointsAndLinesAreNoTriangles) {
  const absl::StatusOr<Scene> scene = LoadText("v 0 0 0\np 1\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_TRUE(scene->meshes[0].primitives.at(0).points_or_lines);
}

// Corners that differ in one list cost no more than others.
TEST(ObjTest, ManyKindsOfOneCornerStayLinear) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  constexpr int kCount = 50'000;
  for (int i = 0; i < kCount; ++i) text += "vt 0 0\n";
  for (int i = 1; i <= kCount; ++i) {
    const std::string t = std::to_string(i);
    text += "f 1/" + t + " 2/" + t + " 3/" + t + "\n";
  }
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].primitives[0].positions.size(), 3u * kCount);
}

TEST(ObjTest, EndsWithItsJobAndGivesItsMemoryBack) {
  std::string text(kObjSquare);
  for (int i = 0; i < 10'000; ++i) text += "f 1 2 3 4\n";
  const std::vector<uint8_t> bytes = testing::TextBytes(text);
  MemoryBudget memory(100'000);
  JobContext job;
  job.set_memory(&memory);
  EXPECT_EQ(LoadObj(job, bytes, {}).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(memory.used_bytes(), 0u);
  memory.set_limit_bytes(10'000'000);
  EXPECT_TRUE(LoadObj(job, bytes, {}).ok());
  EXPECT_EQ(memory.used_bytes(), 0u);
  job.Cancel();
  EXPECT_EQ(LoadObj(job, bytes, {}).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace voxelpipe
