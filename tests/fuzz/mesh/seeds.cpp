#include "fuzz/mesh/seeds.h"

#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <meshoptimizer.h>
#include <array>

namespace voxelpipe::fuzz {
namespace {

using nlohmann::json;
using testing::AsBytes;
using testing::GlbBuilder;
using testing::kF32;
using testing::kU16;
using testing::kU8;
using testing::Shape;

GlbBuilder Cube() {
  GlbBuilder b;
  const Shape cube = testing::CubeShape();
  b.Mesh(b.Primitive(cube.positions, cube.indices));
  b.Node({{"mesh", 0}});
  b.Scene({0});
  return b;
}

// Materials with three textures, one PNG each, samplers and a texture transform.
GlbBuilder Textured() {
  GlbBuilder b = Cube();
  json& primitive = b.doc["meshes"][0]["primitives"][0];
  std::vector<float> uv;
  for (int i = 0; i < 8; ++i) uv.insert(uv.end(), {float(i & 1), float(i / 2 & 1)});
  primitive["attributes"]["TEXCOORD_0"] = b.Vectors(uv, "VEC2");
  primitive["material"] = 0;
  for (const uint32_t side : {2u, 4u, 3u}) {
    testing::ByteVector rgba;
    for (uint32_t i = 0; i < side * side * 4; ++i) rgba.push_back(uint8_t(i * 37));
    const int view = b.View(testing::MakePng(side, side, rgba));
    b.doc["images"].push_back({{"bufferView", view}, {"mimeType", "image/png"}});
    b.doc["textures"].push_back({{"source", b.doc["images"].size() - 1}, {"sampler", 0}});
  }
  b.doc["samplers"] = {{{"magFilter", 9729}, {"minFilter", 9987}, {"wrapS", 10497}, {"wrapT", 33071}}};
  b.doc["materials"] = {
      {{"pbrMetallicRoughness",
        {{"baseColorTexture",
          {{"index", 0}, {"extensions", {{"KHR_texture_transform", {{"scale", {2, 3}}, {"rotation", 0.5}}}}}}},
         {"metallicRoughnessTexture", {{"index", 2}}},
         {"baseColorFactor", {1, 0.5, 0.25, 1}}}},
       {"emissiveTexture", {{"index", 1}}},
       {"emissiveFactor", {1, 1, 1}},
       {"alphaMode", "MASK"},
       {"alphaCutoff", 0.25}}};
  b.doc["extensionsUsed"] = {"KHR_texture_transform"};
  return b;
}

// Strips, fans, sparse accessors, own attributes, colours, vertex formats of one and two bytes.
GlbBuilder Accessors() {
  GlbBuilder b;
  const Shape ball = testing::IcosphereShape(1);
  json primitive = b.Primitive(ball.positions, ball.indices);
  const size_t count = ball.positions.size();
  primitive["attributes"]["_HEAT"] = b.Vectors(std::vector<float>(count, 2.5f), "SCALAR");
  primitive["attributes"]["COLOR_0"] =
      b.Accessor(b.View(testing::ByteVector(count * 4, 200)), kU8, "VEC4", count, /*normalized=*/true);
  b.Mesh(primitive);
  const int positions = primitive["attributes"]["POSITION"];
  const int index_view = b.View(AsBytes(std::vector<uint16_t>{0, 3, 5}));
  const int value_view = b.View(AsBytes(std::vector<float>{0, 0, 2, 0, 2, 0, 2, 0, 0}));
  b.doc["accessors"][size_t(positions)]["sparse"] = {{"count", 3},
                                                     {"indices", {{"bufferView", index_view}, {"componentType", kU16}}},
                                                     {"values", {{"bufferView", value_view}}}};
  for (const int mode : {5, 6, 4, 0, 1}) {
    json other = b.Primitive({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}});
    other["mode"] = mode;
    b.doc["meshes"][0]["primitives"].push_back(other);
  }
  b.Node({{"mesh", 0}, {"translation", {1, 2, 3}}, {"rotation", {0, 0, 0.6, 0.8}}, {"scale", {1, -2, 1}}});
  b.Node({{"children", {0}}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1}}});
  b.Scene({1});
  return b;
}

// A skin, a morph target, an animation of a joint, instances.
GlbBuilder Moving() {
  GlbBuilder b = Cube();
  json& primitive = b.doc["meshes"][0]["primitives"][0];
  primitive["attributes"]["JOINTS_0"] = b.Accessor(b.View(testing::ByteVector(32, 0)), kU8, "VEC4", 8);
  std::vector<float> weights;
  for (int i = 0; i < 8; ++i) weights.insert(weights.end(), {1, 0, 0, 0});
  primitive["attributes"]["WEIGHTS_0"] = b.Vectors(weights, "VEC4");
  primitive["targets"] = {{{"POSITION", b.Vectors(std::vector<float>(24, 0.5f), "VEC3")}}};
  b.doc["meshes"][0]["weights"] = {0.5};
  const int joint = b.Node({{"translation", {0, 1, 0}}});
  b.doc["skins"] = {{{"joints", {joint}}, {"skeleton", joint}}};
  b.doc["nodes"][0]["skin"] = 0;
  const int times = b.Vectors({0, 1, 2}, "SCALAR"), places = b.Vectors({0, 0, 0, 1, 1, 1, 2, 2, 2}, "VEC3");
  b.doc["animations"] = {{{"samplers", {{{"input", times}, {"output", places}, {"interpolation", "LINEAR"}}}},
                          {"channels", {{{"sampler", 0}, {"target", {{"node", joint}, {"path", "translation"}}}}}}}};
  const int instances = b.Vectors({0, 0, 0, 3, 0, 0, 0, 3, 0}, "VEC3");
  b.Node({{"mesh", 0}, {"extensions", {{"EXT_mesh_gpu_instancing", {{"attributes", {{"TRANSLATION", instances}}}}}}}});
  b.doc["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
  b.Scene({0, joint, int(b.doc["nodes"].size()) - 1});
  return b;
}

GlbBuilder WithDraco() {
  GlbBuilder b;
  const int view = b.View(DracoStream(false));
  b.doc["accessors"] = {
      {{"componentType", kF32}, {"count", 8}, {"type", "VEC3"}, {"min", {0, 0, 0}}, {"max", {1, 1, 1}}},
      {{"componentType", testing::kU32}, {"count", 36}, {"type", "SCALAR"}},
      {{"componentType", kF32}, {"count", 8}, {"type", "VEC3"}}};
  b.Mesh(
      {{"attributes", {{"POSITION", 0}, {"NORMAL", 2}}},
       {"indices", 1},
       {"extensions",
        {{"KHR_draco_mesh_compression", {{"bufferView", view}, {"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}}}}}});
  b.doc["extensionsRequired"] = b.doc["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  b.Node({{"mesh", 0}});
  b.Scene({0});
  return b;
}

GlbBuilder WithMeshopt() {
  GlbBuilder b = Cube();
  const Shape cube = testing::CubeShape();
  testing::ByteVector vertices(meshopt_encodeVertexBufferBound(8, 12));
  vertices.resize(meshopt_encodeVertexBuffer(vertices.data(), vertices.size(), cube.positions.data(), 8, 12));
  testing::ByteVector indices(meshopt_encodeIndexBufferBound(36, 8));
  indices.resize(meshopt_encodeIndexBuffer(indices.data(), indices.size(), cube.indices.data(), 36));
  const int first = b.View(vertices), second = b.View(indices);
  const auto compress = [&](int accessor, int compressed, int stride, int count, const char* mode) {
    json& view = b.doc["bufferViews"][b.doc["accessors"][size_t(accessor)]["bufferView"].get<size_t>()];
    json object = b.doc["bufferViews"][size_t(compressed)];
    object.update({{"byteStride", stride}, {"count", count}, {"mode", mode}});
    view["extensions"]["EXT_meshopt_compression"] = object;
  };
  compress(0, first, 12, 8, "ATTRIBUTES");
  compress(1, second, 4, 36, "TRIANGLES");
  b.doc["extensionsRequired"] = b.doc["extensionsUsed"] = {"EXT_meshopt_compression"};
  return b;
}

Seed DracoFile(const std::string& name, bool sequential) {
  Seed seed;
  seed.name = name;
  seed.file = DracoStream(sequential);
  return seed;
}

std::vector<Seed> MakeSeeds() {
  std::vector<Seed> seeds;
  const auto add = [&](const char* name, GlbBuilder gltf, bool text) {
    seeds.push_back({name, std::move(gltf), {}, text});
  };
  add("cube", Cube(), false);
  add("cube.gltf", Cube(), true);
  add("textured", Textured(), false);
  add("textured.gltf", Textured(), true);
  add("accessors", Accessors(), false);
  add("moving", Moving(), false);
  add("draco", WithDraco(), false);
  add("meshopt", WithMeshopt(), false);
  seeds.push_back(DracoFile("edgebreaker", false));
  seeds.push_back(DracoFile("sequential", true));
  const auto add_files = [&](const char* name, const std::vector<std::vector<uint8_t>>& files) {
    for (const std::vector<uint8_t>& file : files) {
      Seed& seed = seeds.emplace_back();
      seed.name = name;
      seed.file = file;
    }
  };
  add_files("stl", StlFiles());
  add_files("ply", PlyFiles());
  add_files("off", OffFiles());
  add_files("obj", ObjFiles());
  add_files("3mf", ThreemfFiles());
  return seeds;
}

}  // namespace

const std::vector<Seed>& Seeds() {
  static const std::vector<Seed> seeds = MakeSeeds();
  return seeds;
}

std::vector<uint8_t> DracoStream(bool sequential) {
  const Shape cube = testing::CubeShape();
  const int faces = int(cube.indices.size() / 3);
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(faces);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = builder.AddAttribute(draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const std::array<float, 3> up{0, 0, 1};
  for (int f = 0; f < faces; ++f) {
    const Vec3f* corners[3];
    for (size_t c = 0; c < 3; ++c) corners[c] = &cube.positions[cube.indices[size_t(f) * 3 + c]];
    const draco::FaceIndex face{uint32_t(f)};
    builder.SetAttributeValuesForFace(position, face, corners[0], corners[1], corners[2]);
    builder.SetAttributeValuesForFace(normal, face, up.data(), up.data(), up.data());
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(sequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetAttributeQuantization(position, 11);
  encoder.SetAttributeQuantization(normal, 8);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return {};
  return {buffer.data(), buffer.data() + buffer.size()};
}

}  // namespace voxelpipe::fuzz
