// Meshes in STL, PLY, OFF, OBJ and 3MF on the command line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "cli_runner.h"
#include "encode/format_registry.h"
#include "support/json/json.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/zip_maker.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using ::testing::HasSubstr;
using testing::ParseJson;
using testing::RunCli;
using testing::TemporaryDirectory;

constexpr char kTetrahedron[] = "v 0 0 0\nv 20 0 0\nv 0 20 0\nv 0 0 20\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

class CliFormats : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    const std::string path = directory_ / name;
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  static json Voxelize(const std::string& path, std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"voxelize", path, "--resolution", "16", "--json"});
    const CliOutcome outcome = RunCli(more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.exit_code == 0 ? ParseJson(outcome.out) : json::object();
  }
  TemporaryDirectory directory_;
};

TEST_F(CliFormats, TheSameSolidInEveryFormat) {
  const std::string off = "OFF\n4 4 0\n0 0 0\n20 0 0\n0 20 0\n0 0 20\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 4\nproperty list uchar int vertex_index\nend_header\n" +
      off.substr(off.find("0 0 0\n"));
  const std::string model = testing::Model3mf(
      "<object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"20\" y=\"0\" z=\"0\"/><vertex "
      "x=\"0\" y=\"20\" z=\"0\"/><vertex x=\"0\" y=\"0\" z=\"20\"/></vertices><triangles><triangle v1=\"0\" v2=\"2\" "
      "v3=\"1\"/><triangle v1=\"0\" v2=\"1\" v3=\"3\"/><triangle v1=\"0\" v2=\"3\" v3=\"2\"/><triangle v1=\"1\" "
      "v2=\"2\" v3=\"3\"/></triangles></mesh></object>",
      "<item objectid=\"1\"/>");
  const json obj = Voxelize(Write("a.obj", kTetrahedron), {"--fill", "parity", "--unit", "mm"});
  EXPECT_EQ(obj["triangles"], 4);
  EXPECT_EQ(obj["voxel_size"][0], 20 * 0.001 / 16);
  for (const std::string& path : {Write("a.off", off), Write("a.ply", ply)}) {
    const json other = Voxelize(path, {"--fill", "parity", "--unit", "mm"});
    EXPECT_EQ(other["hash"], obj["hash"]) << path;
    EXPECT_EQ(other["voxel_size"], obj["voxel_size"]) << path;
  }
  const json package = Voxelize(Write("a.3mf", testing::Package3mf(model).Bytes()), {"--fill", "parity"});
  EXPECT_EQ(package["hash"], obj["hash"]);
  EXPECT_EQ(package["voxel_size"], obj["voxel_size"]);
}

TEST_F(CliFormats, InfoSaysTheUnit) {
  const std::string path = Write("a.obj", kTetrahedron);
  EXPECT_THAT(RunCli({"info", path}).out,
              HasSubstr("unit        no unit; --unit mm|cm|m|in scales the file to metres"));
  EXPECT_THAT(RunCli({"info", path}).out, HasSubstr("size        20 x 20 x 20\n"));
  EXPECT_THAT(RunCli({"info", path, "--unit", "mm"}).out, HasSubstr("size        0.02 x 0.02 x 0.02 metres"));
  EXPECT_EQ(ParseJson(RunCli({"info", path, "--json"}).out)["unit"], nullptr);
  EXPECT_EQ(ParseJson(RunCli({"info", path, "--json", "--unit", "in"}).out)["unit"], "in");
  const testing::ByteVector glb = testing::CubeGlb();
  const std::string cube = Write("cube.glb", {glb.begin(), glb.end()});
  const CliOutcome refused = RunCli({"info", cube, "--unit", "mm"});
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("the file has a unit of its own (m)"));
  EXPECT_EQ(RunCli({"info", path, "--unit", "km"}).exit_code, 2);
}

TEST_F(CliFormats, TheExtensionSaysWhatTheContentDoesNot) {
  const std::string path = Write("cut.stl", std::string(80, 'x') + std::string("\5\0\0\0", 4) + std::string(50, 'y'));
  EXPECT_THAT(RunCli({"info", path}).err, HasSubstr("STL: byte 80: 5 triangles take 334 bytes, the file has 134"));
  const std::string other = Write("mesh.dat", std::string("bogus 1\n") + kTetrahedron);
  EXPECT_THAT(RunCli({"info", other}).err, HasSubstr("the mesh is of no known format; GLB"));
  EXPECT_EQ(RunCli({"info", other, "--input-format", "obj"}).exit_code, 0);
  EXPECT_EQ(RunCli({"info", other, "--input-format", "jpg"}).exit_code, 2);
}

TEST_F(CliFormats, MaterialsAndTexturesAreReadBesideAnObj) {
  const testing::ByteVector png = testing::MakePng(1, 1, {255, 0, 0, 255});
  Write("parts/wood.png", {png.begin(), png.end()});
  Write("parts/all.mtl", "newmtl wood\nmap_Kd wood.png\n");
  std::string text = kTetrahedron;
  for (size_t at = 0; (at = text.find("f ", at)) != std::string::npos; at += 2) {
    const size_t end = text.find('\n', at);
    std::string corners = text.substr(at, end - at);
    for (char digit : {'1', '2', '3', '4'}) {
      const size_t corner = corners.find(std::string(" ") + digit);
      if (corner != std::string::npos) corners.insert(corner + 2, "/1");
    }
    text.replace(at, end - at, corners);
    at += corners.size() - 2;
  }
  const std::string path = Write("a.obj", "mtllib parts/all.mtl\nvt 0.5 0.5\nusemtl wood\n" + text);
  const json red = Voxelize(path, {"--target", "u8x3:replace:shader=base_color"});
  const json expected = Voxelize(Write("b.obj", kTetrahedron),
                                 {"--shader", "constant:value=1/0/0", "--target", "u8x3:replace:scale=255"});
  EXPECT_EQ(red["warnings"], json::array());
  EXPECT_EQ(red["hash"], expected["hash"]);
}

TEST_F(CliFormats, DrawnFilesHaveTheColoursOfTheMesh) {
  Write("all.mtl", "newmtl red\nKd 1 0 0\n");
  const std::string white = Write("white.obj", kTetrahedron);
  const std::string red = Write("red.obj", std::string("mtllib all.mtl\nusemtl red\n") + kTetrahedron);
  const auto written = [&](const std::string& mesh, const std::string& name, std::vector<std::string> options) {
    options.insert(options.end(), {"-o", directory_ / name});
    Voxelize(mesh, options);
    return testing::ReadFile(directory_ / name);
  };
  const std::string colours = "u8x4:replace:shader=base_color,encoding=srgb,fill=255";
  for (const std::string extension : {".vox", ".glb", ".merged.glb", ".png", ".html"}) {
    if (FindFormat(extension) == nullptr) continue;  // not in this build
    for (const char* fill : {"none", "parity"}) {
      SCOPED_TRACE(extension + " " + fill);
      for (const std::string& mesh : {white, red}) {
        EXPECT_EQ(written(mesh, "a" + extension, {"--fill", fill}),
                  written(mesh, "b" + extension, {"--fill", fill, "--target", colours, "--result", "sparse"}));
      }
      EXPECT_NE(written(white, "c" + extension, {"--fill", fill}), written(red, "d" + extension, {"--fill", fill}));
    }
    const std::vector<std::string> inside = {"--fill", "parity", "--coverage", "none"};
    auto bits = inside;
    bits.insert(bits.end(), {"--target", "bit:or"});
    EXPECT_EQ(written(red, "e" + extension, inside), written(red, "f" + extension, bits)) << "nothing is covered";
  }
  EXPECT_EQ(Voxelize(red, {"-o", directory_ / "g.npz"})["result"], "dense") << "as it was";
  EXPECT_EQ(Voxelize(red, {"-o", directory_ / "g.vox", "--result", "dense"})["result"], "dense");
}

// The material 0 of a u8 target is what voxels without a fragment hold in a dense result.
TEST_F(CliFormats, DrawnFilesAndPointsHaveEveryOccupiedVoxel) {
  const std::string mesh = Write("a.obj", kTetrahedron);
  for (const char* target : {"u8:max:shader=material_id", "u8x3:replace:shader=constant,value=0/0/0"}) {
    const std::string path = directory_ / "points.ply";
    const json summary = Voxelize(mesh, {"--fill", "parity", "--target", target, "-o", path});
    EXPECT_GT(summary["occupied"], 0);
    const std::vector<uint8_t> bytes = testing::ReadFile(path);
    const std::string head(bytes.begin(), bytes.begin() + std::min<ptrdiff_t>(400, std::ssize(bytes)));
    EXPECT_THAT(head, HasSubstr("element vertex " + std::to_string(summary["occupied"].get<uint64_t>()) + "\n"));
  }
}

TEST_F(CliFormats, ABatchTakesUnitsByItem) {
  Write("a.obj", kTetrahedron);
  const std::string manifest = Write("jobs.jsonl",
                                     "{\"input\": \"a.obj\", \"id\": \"plain\"}\n"
                                     "{\"input\": \"a.obj\", \"id\": \"mm\", \"unit\": \"mm\"}\n");
  const std::string out = directory_ / "out";
  const CliOutcome outcome = RunCli({"batch", manifest, "--output-dir", out, "--resolution", "8", "--format", "npz"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::string wrong = Write("wrong.jsonl", "{\"input\": \"a.obj\", \"unit\": \"km\"}\n");
  const CliOutcome refused = RunCli({"batch", wrong, "--output-dir", out});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("wrong.jsonl:1: unit 'km' is none of mm, cm, m, in"));
  // An earlier result in another unit does not count as done.
  const std::string changed = Write("jobs.jsonl", "{\"input\": \"a.obj\", \"id\": \"plain\", \"unit\": \"cm\"}\n");
  const CliOutcome again =
      RunCli({"batch", changed, "--output-dir", out, "--resolution", "8", "--format", "npz", "--json"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(ParseJson(again.out)["done"], 1) << again.out;
}

}  // namespace
}  // namespace voxelpipe
