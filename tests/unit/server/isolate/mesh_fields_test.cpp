// Meshes to bytes and back, and what a process that was taken over could send instead.
#include "isolate/mesh_fields.h"

#include <random>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "mesh/health/check_mesh.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/hostile_meshes.h"
#include "support/meshes/meshes.h"

namespace voxelpipe {
namespace {

using namespace testing;
using nlohmann::json;

struct Written {
  std::vector<uint8_t> text, bulk;
};

template <typename T>
Written Write(const T& value) {
  ArchiveWriter writer;
  Fields(writer, value);
  Written bytes{writer.text(), std::vector<uint8_t>(writer.bulk_bytes())};
  writer.CopyBulk(bytes.bulk.data());
  return bytes;
}

absl::Status Read(const Written& bytes, LoadedMesh& loaded) {
  ArchiveReader reader(bytes.text, bytes.bulk);
  Fields(reader, loaded);
  absl::Status status = reader.Finish();
  return status.ok() ? CheckMesh(loaded.mesh) : status;
}

LoadedMesh Load(const ByteVector& file, const TextureUse& textures = {}) {
  const JobContext job;
  auto loaded = LoadMeshFor(job, file, {MeshFormat::kAuto, textures, {}});
  EXPECT_TRUE(loaded.ok()) << loaded.status();
  return *std::move(loaded);
}

// A box of 8 vertices, skinned to two joints, with a morph target and an animation of everything.
ByteVector RiggedGlb() {
  GlbBuilder b;
  const Shape cube = CubeShape();
  json primitive = b.Primitive(cube.positions, cube.indices);
  std::vector<float> moved, weights;
  std::vector<uint8_t> joints;
  for (size_t v = 0; v < cube.positions.size(); ++v) {
    moved.insert(moved.end(), {0, 1, 0});
    joints.insert(joints.end(), {uint8_t(v % 2), 0, 0, 0});
    weights.insert(weights.end(), {1, 0, 0, 0});
  }
  primitive["targets"] = {{{"POSITION", b.Vectors(moved, "VEC3")}}};
  primitive["attributes"]["JOINTS_0"] = b.Accessor(b.View(joints), kU8, "VEC4", cube.positions.size());
  primitive["attributes"]["WEIGHTS_0"] = b.Vectors(weights, "VEC4");
  const int mesh = b.Mesh(primitive);
  const int root = b.Node({{"name", "root"}}), arm = b.Node({{"name", "arm"}});
  b.doc["nodes"][size_t(root)]["children"] = {arm};
  b.doc["skins"] = {{{"joints", {root, arm}}}};
  const int body = b.Node({{"mesh", mesh}, {"skin", 0}});
  const int times = b.Vectors({0, 1}, "SCALAR");
  json samplers = json::array(), channels = json::array();
  const auto add = [&](int node, const char* path, int values, const char* how) {
    channels.push_back({{"sampler", samplers.size()}, {"target", {{"node", node}, {"path", path}}}});
    samplers.push_back({{"input", times}, {"output", values}, {"interpolation", how}});
  };
  add(root, "translation", b.Vectors({0, 0, 0, 1, 0, 0}, "VEC3"), "LINEAR");
  add(arm, "rotation", b.Vectors({0, 0, 0, 1, 0, 0, 1, 0}, "VEC4"), "STEP");
  add(body, "weights", b.Vectors({0, 1}, "SCALAR"), "LINEAR");
  b.doc["animations"] = {{{"name", "wave"}, {"samplers", samplers}, {"channels", channels}}};
  b.Scene({root, body});
  return b.Glb();
}

TEST(MeshFieldsTest, AMeshComesBackAsItWas) {
  const TextureUse textures{true, true, true};
  for (const ByteVector& file : {RiggedGlb(), TexturedQuadGlb(), TorusGlb(200, 200), CubeGlb(), ManyOwnAttributes(9)}) {
    const LoadedMesh loaded = Load(file, textures);
    const Written bytes = Write(loaded);
    LoadedMesh read;
    const absl::Status status = Read(bytes, read);
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(read.mesh.positions, loaded.mesh.positions);
    EXPECT_EQ(read.mesh.triangles, loaded.mesh.triangles);
    EXPECT_EQ(read.mesh.parts.size(), loaded.mesh.parts.size());
    EXPECT_EQ(read.mesh.unused_vertices, loaded.mesh.unused_vertices);
    EXPECT_EQ(read.mesh.images.size(), loaded.mesh.images.size());
    EXPECT_EQ(read.mesh.rig == nullptr, loaded.mesh.rig == nullptr);
    EXPECT_EQ(read.contents.file_bytes, file.size());
    // All fields, those of the rig too.
    const Written again = Write(read);
    EXPECT_EQ(again.text, bytes.text);
    EXPECT_EQ(again.bulk, bytes.bulk);
  }
  ASSERT_NE(Load(RiggedGlb()).mesh.rig, nullptr) << "or the test is about nothing";
  ASSERT_FALSE(Load(TexturedQuadGlb(), textures).mesh.images.at(0)->rgba.empty());
  ASSERT_FALSE(Load(ManyOwnAttributes(9)).mesh.attributes.at(0).runs.empty());
}

// Shared data must not be sent several times.
TEST(MeshFieldsTest, ImagesThatAreOneStayOne) {
  const LoadedMesh loaded = Load(LargePngs(64, 4), {true, true, true});
  ASSERT_EQ(loaded.mesh.images.at(3), loaded.mesh.images.at(0));
  const Written bytes = Write(loaded);
  LoadedMesh read;
  const absl::Status status = Read(bytes, read);
  ASSERT_TRUE(status.ok()) << status;
  ASSERT_EQ(read.mesh.images.size(), 4u);
  for (const auto& image : read.mesh.images) EXPECT_EQ(image, read.mesh.images[0]);
  EXPECT_EQ(read.mesh.images[0]->rgba, loaded.mesh.images[0]->rgba);
  EXPECT_EQ(Write(read).text, bytes.text);
}

TEST(MeshFieldsTest, AStatusComesBackWithItsNumbers) {
  ArchiveWriter writer;
  Fields(writer, MakeLimitError("too much", {7, 5, 0}));
  ArchiveReader reader(writer.text(), {});
  absl::Status status;
  Fields(reader, status);
  ASSERT_TRUE(reader.Finish().ok());
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(status.message(), "too much");
  ASSERT_TRUE(LimitErrorOf(status).has_value());
  EXPECT_EQ(LimitErrorOf(status)->need_bytes, 7u);
}

// Bytes that a hostile process made of good ones are read without a crash (with a sanitizer: without a fault), and what
// passes is a mesh.
TEST(MeshFieldsTest, ChangedBytesAreRefusedOrHarmless) {
  std::mt19937 random(7);
  int refused = 0;
  for (const ByteVector& file : {RiggedGlb(), TexturedQuadGlb(), ManyOwnAttributes(9)}) {
    const Written bytes = Write(Load(file, {true, true, true}));
    for (int round = 0; round < 4000; ++round) {
      Written changed = bytes;
      for (uint32_t n = random() % 3; n < 3; ++n) {
        std::vector<uint8_t>& in = !changed.bulk.empty() && random() % 2 == 0 ? changed.bulk : changed.text;
        const uint8_t values[] = {0, 1, 0x7f, 0x80, 0xff, uint8_t(random())};
        const size_t at = random() % in.size(), length = std::min<size_t>(in.size() - at, 1 + random() % 8);
        std::fill_n(in.begin() + ptrdiff_t(at), length, values[random() % std::size(values)]);
      }
      LoadedMesh read;
      const absl::Status status = Read(changed, read);
      if (!status.ok()) {
        ++refused;
        continue;
      }
      for (const auto& triangle : read.mesh.triangles) {
        for (const uint32_t v : triangle) ASSERT_LT(v, read.mesh.positions.size());
      }
    }
  }
  EXPECT_GT(refused, 1000);
}

// Each a promise of triangle_mesh.h, material.h or rig.h.
TEST(MeshCheckTest, EachBrokenPromiseIsFound) {
  const auto expect_broken = [](const ByteVector& file, const char* what, auto change) {
    LoadedMesh loaded = Load(file, {true, true, true});
    ASSERT_TRUE(CheckMesh(loaded.mesh).ok()) << CheckMesh(loaded.mesh);
    change(loaded.mesh);
    EXPECT_EQ(CheckMesh(loaded.mesh).code(), absl::StatusCode::kInvalidArgument) << what;
  };
  const ByteVector quad = TexturedQuadGlb(), rigged = RiggedGlb();
  expect_broken(quad, "index", [](TriangleMesh& m) { m.triangles[0][2] = uint32_t(m.positions.size()); });
  expect_broken(quad, "normals", [](TriangleMesh& m) { m.normals.pop_back(); });
  expect_broken(quad, "position", [](TriangleMesh& m) { m.positions[0].y = std::numeric_limits<double>::infinity(); });
  expect_broken(quad, "nan", [](TriangleMesh& m) { m.positions[0].x = std::numeric_limits<double>::quiet_NaN(); });
  expect_broken(quad, "unused", [](TriangleMesh& m) { m.unused_vertices = {4}; });
  expect_broken(quad, "parts", [](TriangleMesh& m) { ++m.parts[0].triangle_count; });
  expect_broken(quad, "gap", [](TriangleMesh& m) { m.parts[0].first_vertex = 1; });
  expect_broken(quad, "no parts", [](TriangleMesh& m) { m.parts.clear(); });
  expect_broken(quad, "part's flags", [](TriangleMesh& m) { m.parts[0].has_colors = true; });
  expect_broken(quad, "material", [](TriangleMesh& m) { m.parts[0].material = 1; });
  expect_broken(quad, "texture", [](TriangleMesh& m) { m.materials[0].base_color.texture = 1; });
  expect_broken(quad, "negative texture", [](TriangleMesh& m) { m.materials[0].base_color.texture = -2; });
  expect_broken(quad, "image", [](TriangleMesh& m) { m.textures[0].image = 5; });
  expect_broken(quad, "texels", [](TriangleMesh& m) { m.images[0]->rgba.pop_back(); });
  expect_broken(quad, "width", [](TriangleMesh& m) { m.images[0]->width = 1u << 31, m.images[0]->height = 1u << 31; });
  expect_broken(quad, "mips", [](TriangleMesh& m) { m.images[0]->srgb_mips.resize(9); });
  expect_broken(quad, "attribute", [](TriangleMesh& m) { m.attributes.push_back({"_A", 5, std::vector<float>(20)}); });
  const ByteVector own = ManyOwnAttributes(3);
  expect_broken(own, "run's end", [](TriangleMesh& m) { ++m.attributes[2].runs[0].end_vertex; });
  expect_broken(own, "run's begin", [](TriangleMesh& m) { --m.attributes[2].runs[0].first_vertex; });
  expect_broken(own, "run's values", [](TriangleMesh& m) { ++m.attributes[1].runs[0].first_value; });
  expect_broken(own, "runs out of order", [](TriangleMesh& m) {
    m.attributes[1].runs.push_back({0, 3, 12});
    m.attributes[1].values.resize(24);
  });
  expect_broken(own, "no runs", [](TriangleMesh& m) { m.attributes[1].runs.clear(); });
  expect_broken(own, "a triangle of two parts", [](TriangleMesh& m) { m.triangles[0][1] = 3; });
  const auto expect_broken_rig = [&](const char* what, auto change) {
    expect_broken(rigged, what, [&](TriangleMesh& m) {
      auto rig = std::make_shared<Rig>(*m.rig);
      change(*rig);
      m.rig = rig;
    });
  };
  expect_broken_rig("order", [](Rig& r) { r.order[0] = r.order[1]; });
  expect_broken_rig("parent", [](Rig& r) { r.nodes[0].parent = 100; });
  expect_broken_rig("cycle", [](Rig& r) { r.nodes[0].parent = 1, r.nodes[1].parent = 0; });
  expect_broken_rig("joint", [](Rig& r) { r.skins[0].joints[0] = 100; });
  expect_broken_rig("matrices", [](Rig& r) { r.skins[0].inverse_bind_matrices.pop_back(); });
  expect_broken_rig("skin", [](Rig& r) { r.parts[0].skin = 1; });
  expect_broken_rig("no joints", [](Rig& r) { r.skins[0] = {}; });
  expect_broken_rig("node", [](Rig& r) { r.parts[0].node = 100; });
  expect_broken_rig("parts", [](Rig& r) { r.parts.pop_back(); });
  expect_broken_rig("primitive", [](Rig& r) { r.parts[0].primitive = nullptr; });
  expect_broken_rig("channel", [](Rig& r) { r.animations[0].channels[0].sampler = 9; });
  expect_broken_rig("channel's node", [](Rig& r) { r.animations[0].channels[0].node = 9; });
  expect_broken_rig("width", [](Rig& r) { r.animations[0].samplers[0].width = 6; });
  expect_broken_rig("wide rotation", [](Rig& r) {
    r.animations[0].samplers[1].width = 8;
    r.animations[0].samplers[1].values.resize(16);
  });
  expect_broken_rig("values", [](Rig& r) { r.animations[0].samplers[0].values.pop_back(); });
  expect_broken_rig("times", [](Rig& r) { r.animations[0].samplers[0].times[1] = 0; });
  expect_broken_rig("morph", [](Rig& r) {
    auto primitive = std::make_shared<Primitive>(*r.parts[0].primitive);
    auto morph = std::make_shared<MorphData>(*primitive->morph);
    morph->targets[0].positions.pop_back();
    primitive->morph = morph;
    r.parts[0].primitive = primitive;
  });
  expect_broken_rig("joints", [](Rig& r) {
    auto primitive = std::make_shared<Primitive>(*r.parts[0].primitive);
    primitive->joints[0].pop_back();
    r.parts[0].primitive = primitive;
  });
}

}  // namespace
}  // namespace voxelpipe
