// Coordinates of a survey, millions of metres from the origin: formats that have them in double keep them.
#include <cstring>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "mesh/flatten.h"
#include "support/meshes/zip_maker.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::LoadText;

const Vec3d kFirst{701362.1, 4485513.2, 812.3}, kSecond{701362.4, 4485513.2, 812.3}, kThird{701362.1, 4485513.7, 812.4};

void ExpectKept(const std::string& text, double scale = 1) {
  const absl::StatusOr<Scene> scene = LoadText(text);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  const std::vector<Vec3d> positions(mesh->positions.begin(), mesh->positions.end());
  EXPECT_THAT(positions, ElementsAre(kFirst * scale, kSecond * scale, kThird * scale));
}

std::string PlyHead(const char* format, const char* type) {
  std::string head = std::string("ply\nformat ") + format + " 1.0\nelement vertex 3\n";
  for (const char* axis : {"x", "y", "z"}) head += std::string("property ") + type + " " + axis + "\n";
  return head + "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
}

constexpr char kVertices[] = "701362.1 4485513.2 812.3\n701362.4 4485513.2 812.3\n701362.1 4485513.7 812.4\n";

TEST(DoublePositions, AreKeptByFormatsThatHaveThem) {
  ExpectKept("v 701362.1 4485513.2 812.3\nv 701362.4 4485513.2 812.3\nv 701362.1 4485513.7 812.4\nf 1 2 3\n");
  ExpectKept(std::string("OFF\n3 1 0\n") + kVertices + "3 0 1 2\n");
  ExpectKept(PlyHead("ascii", "double") + kVertices + "3 0 1 2\n");
  std::string binary = PlyHead("binary_little_endian", "double");
  for (const Vec3d& p : {kFirst, kSecond, kThird}) binary.append(reinterpret_cast<const char*>(&p), sizeof p);
  binary.append("\x03\0\0\0\0\x01\0\0\0\x02\0\0\0", 13);
  ExpectKept(binary);
  const std::string object =
      "<object id=\"1\" type=\"model\"><mesh><vertices><vertex x=\"701362.1\" y=\"4485513.2\" z=\"812.3\"/>"
      "<vertex x=\"701362.4\" y=\"4485513.2\" z=\"812.3\"/><vertex x=\"701362.1\" y=\"4485513.7\" z=\"812.4\"/>"
      "</vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object>";
  ExpectKept(testing::Package3mf(testing::Model3mf(object, "<item objectid=\"1\"/>", "unit=\"meter\"")).Bytes());
}

TEST(DoublePositions, AreStoredFromTheFirstThatIsNoFloat) {
  const absl::StatusOr<Scene> scene = LoadText("v 0 0 0\nv 1 0 0\nv 0 0.1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Primitive& primitive = scene->meshes[0].primitives[0];
  EXPECT_THAT(primitive.double_positions,
              ElementsAre(Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0.1, 0}, Vec3d{0, 0, 1}));
  EXPECT_THAT(primitive.positions, ElementsAre(Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{0, 0.1f, 0}, Vec3f{0, 0, 1}));
  const absl::StatusOr<Scene> floats = LoadText("v 0 0 0\nv 1 0 0\nv 0 0.5 0\nf 1 2 3\n");
  EXPECT_THAT(floats->meshes[0].primitives[0].double_positions, IsEmpty());
}

TEST(DoublePositions, AreRoundedWhereAPropertyIsAFloat) {
  const absl::StatusOr<Scene> scene = LoadText(PlyHead("ascii", "float") + kVertices + "3 0 1 2\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->meshes[0].primitives[0].double_positions, IsEmpty());
}

}  // namespace
}  // namespace voxelpipe
