#include "load/stl/stl.h"

#include <cstring>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
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

std::string BinaryStl(const std::vector<float>& coordinates, const std::string& header = "", uint16_t attribute = 0) {
  std::string bytes = header;
  bytes.resize(80, '\0');
  const auto put = [&](const auto& value) { bytes.append(reinterpret_cast<const char*>(&value), sizeof value); };
  put(uint32_t(coordinates.size() / 9));
  for (size_t i = 0; i < coordinates.size(); i += 9) {
    for (int n = 0; n < 3; ++n) put(std::numeric_limits<float>::quiet_NaN());  // normals are not read
    for (size_t c = 0; c < 9; ++c) put(coordinates[i + c]);
    put(attribute);
  }
  return bytes;
}

const std::vector<float> kTwo = {0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 0, 0, 6, 0, 0, 5, 1, 0.5f};

TEST(StlTest, ReadsBinary) {
  const absl::StatusOr<Scene> scene = LoadText(BinaryStl(kTwo));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->format, "stl");
  EXPECT_EQ(scene->unit, "");
  EXPECT_THAT(CornersOf(*scene), ElementsAre(Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{0, 1, 0}, Vec3f{5, 0, 0},
                                             Vec3f{6, 0, 0}, Vec3f{5, 1, 0.5f}));
  EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  EXPECT_TRUE(scene->meshes[0].primitives[0].normals.empty());
}

TEST(StlTest, AHeaderOfSolidIsStillBinary) {
  const absl::StatusOr<Scene> scene = LoadText(BinaryStl(kTwo, "solid facet normal"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(CornersOf(*scene).size(), 6u);
}

TEST(StlTest, ReadsAscii) {
  const char kText[] =
      "solid a name with vertex\r\n"
      "facet normal 0 0 nan\r\n outer loop\r\n  vertex 0 0 0\r\n  vertex +1 0 0\r\n  vertex 0 1e0 0\r\n endloop\r\n"
      "endfacet\r\nendsolid a name\r\n"
      "SOLID\nFACET NORMAL 0 0 1 OUTER LOOP VERTEX 5 0 0 VERTEX 6 0 0 VERTEX 5 1 .5 ENDLOOP ENDFACET\nENDSOLID";
  for (const std::string& text : {std::string(kText), "\xEF\xBB\xBF" + std::string(kText)}) {
    const absl::StatusOr<Scene> scene = LoadText(text);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_THAT(CornersOf(*scene), ElementsAre(Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{0, 1, 0}, Vec3f{5, 0, 0},
                                               Vec3f{6, 0, 0}, Vec3f{5, 1, 0.5f}));
    EXPECT_THAT(scene->warnings.kept(), IsEmpty());
  }
}

TEST(StlTest, ReadsAsciiWithASpaceBehindEnd) {
  const absl::StatusOr<Scene> scene = LoadText(
      "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nend loop\nEND FACET\n"
      "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 2 0 end loop end facet\nend solid a b\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(testing::CornersOf(*scene).size(), 6u);
  EXPECT_THAT(testing::Lines(scene->warnings),
              ::testing::ElementsAre("line 7: 'end loop' is read as one word, here and below"));
  EXPECT_THAT(ErrorOf("solid\nfacet normal 0 0 1\nend\n"), ::testing::HasSubstr("line 3: 'end' ''"));
}

TEST(StlTest, WarnsOfWhatItIgnores) {
  EXPECT_THAT(Codes(LoadText(BinaryStl(kTwo, "", 7))->warnings), ElementsAre("extension_ignored"));
  EXPECT_THAT(Codes(LoadText(BinaryStl(kTwo) + "xyz", MeshFormat::kStl)->warnings), ElementsAre("nonconforming_file"));
  EXPECT_THAT(Codes(LoadText("solid x\n")->warnings), ElementsAre("nonconforming_file"));
}

TEST(StlTest, RefusesMalformedBinaries) {
  const std::string whole = BinaryStl(kTwo);
  EXPECT_THAT(ErrorOf(whole.substr(0, 100), MeshFormat::kStl),
              HasSubstr("STL: byte 80: 2 triangles take 184 bytes, the file has 100; it may be cut off"));
  EXPECT_THAT(ErrorOf(whole.substr(0, 83), MeshFormat::kStl), HasSubstr("begins with 84 bytes of header"));
  std::string huge = whole;
  const uint32_t count = 0xffffffff;
  std::memcpy(huge.data() + 80, &count, sizeof count);
  EXPECT_THAT(ErrorOf(huge, MeshFormat::kStl), HasSubstr("byte 80: 4294967295 triangles take 214748364834 bytes"));
  std::vector<float> odd = kTwo;
  odd[9 + 4] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(ErrorOf(BinaryStl(odd)), "STL: triangle 1, vertex 1 is not finite");
  LoadLimits limits;
  limits.max_triangles = 1;
  EXPECT_THAT(ErrorOf(whole, MeshFormat::kStl, limits), HasSubstr("2 triangles; the limit max_triangles is 1"));
  limits = {};
  limits.max_vertices = 5;
  EXPECT_THAT(ErrorOf(whole, MeshFormat::kStl, limits), HasSubstr("6 vertices; the limit max_vertices is 5"));
}

TEST(StlTest, RefusesMalformedTexts) {
  const std::string head = "solid\nfacet normal 0 0 1\nouter loop\n";
  EXPECT_EQ(ErrorOf(head + "vertex 0 0\n"), "STL: line 4: a vertex has three numbers");
  EXPECT_EQ(ErrorOf(head + "vertex 0 0 x\n"), "STL: line 4: 'x' is no number");
  EXPECT_EQ(ErrorOf(head + "vertex 0 0 nan\n"), "STL: line 4: the vertex is not finite");
  EXPECT_EQ(ErrorOf(head + "vertex 0 0 1e99\n"), "STL: line 4: the vertex is not finite");
  EXPECT_EQ(ErrorOf(head + "vertex 0 0 0\nendloop endfacet"),
            "STL: line 5: a facet of 1 vertices; facets are triangles");
  EXPECT_EQ(ErrorOf(head + "vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 vertex 0 0 0"),
            "STL: line 4: a fourth vertex of the facet; facets are triangles");
  EXPECT_EQ(ErrorOf(head), "STL: line 2: the facet is cut off by the end of the file");
  EXPECT_EQ(ErrorOf(head + "facet normal 0 0 1\n"), "STL: line 4: a facet inside that of line 2");
  EXPECT_EQ(ErrorOf("solid\nvertex 0 0 0\n"), "STL: line 2: a vertex outside a facet");
  EXPECT_EQ(ErrorOf("solid\nendfacet\n"), "STL: line 2: 'endfacet' without 'facet'");
  EXPECT_EQ(ErrorOf(head + "endsolid\n"), "STL: line 4: a facet that began in line 2 has no 'endfacet'");
  EXPECT_THAT(ErrorOf("solid\ncolor 1 1 1\n"), HasSubstr("STL: line 2: 'color' is no statement of an ASCII STL"));
  EXPECT_EQ(ErrorOf("solid\nfacet 0 0 1\n"), "STL: line 2: 'normal' must follow 'facet'");
}

TEST(StlTest, EndsWithItsJob) {
  JobContext job;
  job.Cancel();
  const std::vector<uint8_t> bytes = testing::TextBytes(BinaryStl(kTwo));
  EXPECT_EQ(LoadStl(job, bytes, {}).status().code(), absl::StatusCode::kCancelled);
}

TEST(StlTest, ChargesItsArrays) {
  const std::vector<uint8_t> bytes = testing::TextBytes(BinaryStl(std::vector<float>(9 * 1000)));
  MemoryBudget memory(1 << 10);
  JobContext job;
  job.set_memory(&memory);
  EXPECT_EQ(LoadStl(job, bytes, {}).status().code(), absl::StatusCode::kResourceExhausted);
  memory.set_limit_bytes(1 << 20);
  const absl::StatusOr<Scene> scene = LoadStl(job, bytes, {});
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_GE(memory.used_bytes(), 48'000u);
}

}  // namespace
}  // namespace voxelpipe
