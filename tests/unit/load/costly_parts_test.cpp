#include "load/costly_parts.h"

#include <cstring>
#include <string>
#include <tuple>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {

bool operator==(const CostlyParts& a, const CostlyParts& b) {
  return std::tie(a.compressed, a.instanced, a.images) == std::tie(b.compressed, b.instanced, b.images);
}

namespace {

constexpr CostlyParts kNone, kAll{true, true, true};

CostlyParts Find(const std::string& file, MeshFormat format = MeshFormat::kAuto) {
  return FindCostlyParts({reinterpret_cast<const uint8_t*>(file.data()), file.size()}, format);
}

// A GLB file: header, text, and behind it binary data.
std::string Glb(const std::string& text, const std::string& binary = "") {
  std::string file = "glTF" + std::string(16, '\0') + text + binary;
  const uint32_t version = 2, bytes = uint32_t(file.size()), text_bytes = uint32_t(text.size());
  std::memcpy(&file[4], &version, 4);
  std::memcpy(&file[8], &bytes, 4);
  std::memcpy(&file[12], &text_bytes, 4);
  std::memcpy(&file[16], "JSON", 4);
  return file;
}

TEST(CostlyPartsTest, WhatTheTextNames) {
  for (const bool glb : {false, true}) {
    const auto file = [&](const std::string& text) { return glb ? Glb(text) : text; };
    EXPECT_EQ(Find(file(R"({"asset":{"version":"2.0"},"meshes":[]})")), kNone);
    EXPECT_EQ(Find(file(R"({"extensionsUsed":["KHR_draco_mesh_compression"]})")), (CostlyParts{.compressed = true}));
    EXPECT_EQ(Find(file(R"({"extensionsUsed":["EXT_meshopt_compression"]})")), (CostlyParts{.compressed = true}));
    EXPECT_EQ(Find(file(R"({"extensionsUsed":["EXT_mesh_gpu_instancing"]})")), (CostlyParts{.instanced = true}));
    EXPECT_EQ(Find(file(R"({"images":[{"bufferView":0}]})")), (CostlyParts{.images = true}));
  }
}

TEST(CostlyPartsTest, ADracoFile) {
  EXPECT_EQ(Find("DRACO and a stream behind it"), (CostlyParts{.compressed = true}));
  EXPECT_EQ(Find("", MeshFormat::kDraco), (CostlyParts{.compressed = true}));
}

TEST(CostlyPartsTest, BinaryDataNamesNothing) {
  EXPECT_EQ(Find(Glb("{}", "KHR_draco_mesh_compression \"images\" \\u0041")), kNone);
}

// Its names may be any.
TEST(CostlyPartsTest, TextWithEscapes) {
  EXPECT_EQ(Find(R"({"im\u0061ges":[]})"), kAll);
  EXPECT_EQ(Find(Glb(R"({"im\u0061ges":[]})")), kAll);
}

TEST(CostlyPartsTest, TextThatIsNotAllThere) {
  const std::string glb = Glb(R"({"asset":{"version":"2.0"},"images":[]})");
  EXPECT_EQ(Find(glb.substr(0, 40)), kAll);
  EXPECT_EQ(Find(R"({"asset":{"version":"2.0"})"
                 "\n"),
            kNone);
  EXPECT_EQ(Find(R"({"asset":{"version":)"), kAll);
  EXPECT_EQ(Find("{"), kAll);
  EXPECT_EQ(Find("glTF"), kAll);
  EXPECT_EQ(Find(""), kAll);
}

TEST(CostlyPartsTest, ReadsABoundedBeginning) {
  const std::string blanks(kCostlyPartsBytes, '\n'), json = R"({"asset":{"version":"2.0"}})";
  EXPECT_EQ(Find(json + blanks.substr(0, kCostlyPartsBytes - json.size())), kNone);
  EXPECT_EQ(Find(json + blanks), kAll);
  EXPECT_EQ(Find(blanks), kAll) << "it may be any format";
  EXPECT_EQ(Find(blanks.substr(0, kSniffedBytes)), kNone);
  EXPECT_EQ(Find(Glb(json + blanks)), kAll);
  EXPECT_EQ(Find(Glb(json, blanks + "\"images\"")), kNone) << "binary data";
  EXPECT_EQ(Find("v 0 0 0\n" + blanks), (CostlyParts{.images = true})) << "a library may follow";
  EXPECT_EQ(Find("v 0 0 0\nv 1 0 0\nmtllib a\n"), (CostlyParts{.images = true}));
  EXPECT_EQ(Find("v 0 0 0\nv 1 0 0\nv 0 1 0\n"), kNone);
}

TEST(CostlyPartsTest, WhatIsNoMesh) {
  EXPECT_EQ(Find("something else that is no mesh"), kNone);
}

}  // namespace
}  // namespace voxelpipe
