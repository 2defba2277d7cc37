// How formats are told apart, and the unit of length.
#include "load/decode/mesh_format.h"

#include <cstring>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "mesh/flatten.h"
#include "support/meshes/glb_builder.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using testing::LoadText;
using testing::TextBytes;

TEST(MeshFormatTest, SniffsByContent) {
  const auto sniff = [](std::string_view text) { return SniffMeshFormat(TextBytes(text)); };
  EXPECT_EQ(sniff("ply\nformat ascii 1.0\n"), MeshFormat::kPly);
  EXPECT_EQ(sniff("ply\r\n"), MeshFormat::kPly);
  EXPECT_EQ(sniff("solid x\n"), MeshFormat::kStl);
  EXPECT_EQ(sniff("  SOLID\n"), MeshFormat::kStl);
  EXPECT_EQ(sniff(std::string(84, '\0')), MeshFormat::kStl) << "no triangles";
  EXPECT_EQ(sniff(std::string(85, '\0')), std::nullopt);
  for (const char* keyword :
       {"OFF\n", "COFF\n", "NOFF\n", "CNOFF\n", "STOFF\n", "STCNOFF\n", "# x\nOFF 1 2 3\n", "OFF8 6 0\n"}) {
    EXPECT_EQ(sniff(keyword), MeshFormat::kOff) << keyword;
  }
  EXPECT_EQ(sniff("OFFSET\n"), std::nullopt);
  for (const char* text :
       {"v 0 0 0\n", "# x\n\nmtllib a.mtl\n", "o thing\ng\nv 0 0 0\n", "\xEF\xBB\xBFg\nf", "vn 0 0 1"}) {
    EXPECT_EQ(sniff(text), MeshFormat::kObj) << text;
  }
  EXPECT_EQ(sniff("{\"asset\": {}}"), MeshFormat::kGltf);
  EXPECT_EQ(sniff("\xEF\xBB\xBF {"), MeshFormat::kGltf);
  EXPECT_EQ(sniff("PK\3\4............[Content_Types].xml"), MeshFormat::k3mf);
  for (const char* text : {"", "\n", "hello\n", "PK\3\4 other", "vertex 0 0 0", "g", "o thing\n"}) {
    EXPECT_EQ(sniff(text), std::nullopt) << text;
  }
}

TEST(MeshFormatTest, ABeginningIsEnoughWithTheSize) {
  std::string beginning(84, 'x');
  const uint32_t count = 1000;
  std::memcpy(beginning.data() + 80, &count, sizeof count);
  EXPECT_EQ(SniffMeshFormat(TextBytes(beginning), 84 + 50'000), MeshFormat::kStl);
  EXPECT_EQ(SniffMeshFormat(TextBytes(beginning)), std::nullopt);
}

// The beginning is read wherever a client's call is answered; the rest takes long, and a job.
TEST(MeshFormatTest, SniffsABoundedBeginning) {
  const JobContext job;
  const auto detect = [&](const std::string& text) { return DetectMeshFormat(job, TextBytes(text)).value(); };
  std::string comments;
  while (comments.size() <= kSniffedBytes) comments += "# a long header\n";
  const std::string blanks(kSniffedBytes, '\n'), one_line = "#" + std::string(kSniffedBytes, 'x') + "\n";
  const std::pair<std::string, MeshFormat> kFiles[] = {
      {comments + "v 0 0 0\n", MeshFormat::kObj},    {one_line + "v 0 0 0\n", MeshFormat::kObj},
      {comments + "OFF\n0 0 0\n", MeshFormat::kOff}, {blanks + "{}", MeshFormat::kGltf},
      {blanks + "solid x\n", MeshFormat::kStl},      {"PK\3\4" + blanks + "3D/", MeshFormat::k3mf}};
  for (const auto& [text, format] : kFiles) {
    EXPECT_EQ(SniffMeshFormat(TextBytes(text)), std::nullopt) << Name(format);
    EXPECT_EQ(detect(text), format);
  }
  EXPECT_EQ(detect(comments), MeshFormat::kAuto);
  EXPECT_EQ(detect(blanks + "vertex"), MeshFormat::kAuto);
  // A word that the limit cuts counts as none: it would be "v".
  const std::string cut = std::string(kSniffedBytes - 1, ' ') + "vertex 1 2 3";
  EXPECT_EQ(SniffMeshFormat(TextBytes(cut)), std::nullopt);
  EXPECT_EQ(SniffMeshFormat(TextBytes("{\"a\":\"" + std::string(kSniffedBytes, 'x') + "\"}")), MeshFormat::kGltf);
  EXPECT_EQ(SniffMeshFormat(TextBytes("v 0 0 0\n" + comments)), MeshFormat::kObj);
  const absl::StatusOr<Scene> scene = LoadText(comments + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->format, "obj");
}

TEST(MeshFormatTest, DetectingEndsWithItsJob) {
  JobContext job;
  job.Cancel();
  EXPECT_EQ(DetectMeshFormat(job, TextBytes(std::string(2 * kSniffedBytes, '\n'))).status(), job.Check());
  EXPECT_EQ(DetectMeshFormat(job, TextBytes("ply\n")).value(), MeshFormat::kPly) << "shown by the beginning";
}

TEST(MeshFormatTest, NamesTheFormatOfAnExtension) {
  EXPECT_EQ(MeshFormatOfName("a.b/c.STL"), MeshFormat::kStl);
  EXPECT_EQ(MeshFormatOfName("x.3mf"), MeshFormat::k3mf);
  EXPECT_EQ(MeshFormatOfName("x.auto"), std::nullopt);
  EXPECT_EQ(MeshFormatOfName("stl"), std::nullopt);
  EXPECT_EQ(Name(MeshFormat::kDraco), "drc");
}

TEST(LengthUnitTest, ScalesToMetresInDouble) {
  const char kText[] = "v 0 0 0\nv 1 0 0\nv 0 3 0\nf 1 2 3\n";
  for (const auto& [name, metres] : {std::pair{"mm", 0.001}, {"cm", 0.01}, {"m", 1.0}, {"in", 0.0254}}) {
    const std::optional<LengthUnit> unit = LengthUnitOf(name);
    ASSERT_TRUE(unit.has_value());
    const absl::StatusOr<Scene> scene = LoadText(kText, {MeshFormat::kObj, *unit});
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->unit, name);
    const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene, {});
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    EXPECT_EQ(mesh->positions[1].x, metres);
    EXPECT_EQ(mesh->positions[2].y, 3 * metres);
  }
  EXPECT_EQ(LengthUnitOf("km"), std::nullopt);
}

TEST(LengthUnitTest, AFormatWithAUnitRefusesAnother) {
  const absl::StatusOr<Scene> scene = LoadScene(testing::CubeGlb(), {MeshFormat::kAuto, LengthUnit::kMetre});
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(scene.status().message()), HasSubstr("mesh_unit: the file has a unit of its own (m)"));
  EXPECT_EQ(LoadScene(testing::CubeGlb())->unit, "m");
}

}  // namespace
}  // namespace voxelpipe
