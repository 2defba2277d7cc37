#include "support/meshes/hostile_meshes.h"

#include <png.h>

#include <string>
#include <utility>

namespace voxelpipe::testing {
namespace {

using nlohmann::json;

ByteVector Text(const json& doc) {
  const std::string text = doc.dump();
  return {text.begin(), text.end()};
}

// One node with one mesh.
json OneNode(json node) {
  return {{"asset", {{"version", "2.0"}}},
          {"scene", 0},
          {"scenes", {{{"nodes", {0}}}}},
          {"nodes", json::array({std::move(node)})},
          {"accessors", {{{"componentType", kF32}, {"count", 3}, {"type", "VEC3"}}}}};
}

json Instanced(uint64_t count) {
  json doc =
      OneNode({{"mesh", 0}, {"extensions", {{"EXT_mesh_gpu_instancing", {{"attributes", {{"TRANSLATION", 1}}}}}}}});
  doc["accessors"].push_back({{"componentType", kF32}, {"count", count}, {"type", "VEC3"}});
  return doc;
}

void AppendBytes(png_structp png, png_bytep bytes, size_t count) {
  auto* const out = static_cast<ByteVector*>(png_get_io_ptr(png));
  out->insert(out->end(), bytes, bytes + count);
}

// Black, one bit a texel.
ByteVector BlackPng(uint32_t edge, int texts = 0) {
  std::string spaces(texts > 0 ? 7'000'000 : 0, ' ');
  char key[] = "Comment";
  png_text text = {};
  text.compression = PNG_TEXT_COMPRESSION_zTXt;
  text.key = key;
  text.text = spaces.data();
  text.text_length = spaces.size();
  ByteVector out;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(png, &out, AppendBytes, nullptr);
  png_set_IHDR(png, info, edge, edge, 1, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  for (int i = 0; i < texts; ++i) png_set_text(png, info, &text, 1);
  png_write_info(png, info);
  const ByteVector row((edge + 7) / 8, 0);
  for (uint32_t y = 0; y < edge; ++y) png_write_row(png, row.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return out;
}

}  // namespace

ByteVector InstancesWithoutData(uint64_t count) {
  json doc = Instanced(count);
  doc["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}}}}}};
  return Text(doc);
}

ByteVector EmptyPrimitivesWithoutData(int primitives, uint64_t count) {
  json doc = Instanced(count);
  doc["meshes"] = {{{"primitives", json::array()}}};
  for (int i = 0; i < primitives; ++i) {
    doc["meshes"][0]["primitives"].push_back({{"mode", 0}, {"attributes", {{"POSITION", 0}}}});
  }
  return Text(doc);
}

ByteVector ManyOwnAttributes(int count) {
  json doc = OneNode({{"mesh", 0}});
  doc["accessors"].push_back({{"componentType", kF32}, {"count", 3}, {"type", "VEC4"}});
  json primitives = json::array();
  for (int i = 0; i < count; ++i) {
    primitives.push_back({{"attributes", {{"POSITION", 0}, {"_" + std::to_string(i), 1}}}});
  }
  doc["meshes"] = json::array({{{"primitives", std::move(primitives)}}});
  return Text(doc);
}

namespace {

// As many triangles as images, which are all the same.
ByteVector Textured(const ByteVector& png, int images) {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["attributes"]["TEXCOORD_0"] = builder.Vectors({0, 0, 1, 0, 0, 1}, "VEC2");
  const int view = builder.View(png);
  json mesh = {{"primitives", json::array()}};
  for (int i = 0; i < images; ++i) {
    builder.doc["images"].push_back({{"bufferView", view}, {"mimeType", "image/png"}});
    builder.doc["textures"].push_back({{"source", i}});
    const json texture = {{"index", i}};
    builder.doc["materials"].push_back(
        {{"pbrMetallicRoughness", {{"baseColorTexture", texture}, {"metallicRoughnessTexture", texture}}},
         {"emissiveTexture", texture}});
    primitive["material"] = i;
    mesh["primitives"].push_back(primitive);
  }
  builder.doc["meshes"] = json::array({std::move(mesh)});
  builder.Scene({builder.Node({{"mesh", 0}})});
  return builder.Glb();
}

}  // namespace

ByteVector LargePngs(uint32_t edge, int images) {
  return Textured(BlackPng(edge), images);
}

ByteVector PngWithTexts(int texts) {
  return Textured(BlackPng(1, texts), 1);
}

ByteVector PrimitivesWithoutData(int primitives, int nodes) {
  json doc = OneNode({{"mesh", 0}});
  json list = json::array();
  for (int i = 0; i < primitives; ++i) list.push_back(json::object());
  list.push_back({{"targets", {json::object()}}});
  doc["meshes"] = json::array({{{"primitives", std::move(list)}}});
  for (int i = 0; i < nodes; ++i) doc["nodes"].push_back({{"mesh", 0}, {"weights", {0.001 * (i + 1)}}});
  return Text(doc);
}

ByteVector WeightsOfManyNodes(int weights, int nodes) {
  json doc = OneNode({{"mesh", 0}});
  doc["animations"] = json::array({json::object()});
  doc["meshes"] =
      json::array({{{"primitives", json::array({json::object()})}, {"weights", std::vector<int>(size_t(weights), 0)}}});
  for (int i = 1; i < nodes; ++i) doc["nodes"].push_back({{"mesh", 0}});
  return Text(doc);
}

ByteVector TargetsWithoutData(int targets, uint64_t instances) {
  json doc = Instanced(instances);
  doc["meshes"] = json::array({{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"targets", json::array()}}}}}});
  for (int i = 0; i < targets; ++i) doc["meshes"][0]["primitives"][0]["targets"].push_back(json::object());
  return Text(doc);
}

ByteVector NumbersOfMaterials(int materials, int numbers, const std::string& member) {
  json doc = OneNode({{"mesh", 0}});
  doc["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}}}}}};
  json extension = {{member, std::vector<int>(size_t(numbers), 1)}};
  for (int i = 0; i < materials; ++i) {
    doc["materials"].push_back({{"extensions", {{"KHR_materials_pbrSpecularGlossiness", extension}}}});
  }
  return Text(doc);
}

ByteVector JointsWithoutData(int skins, int joints) {
  json doc = OneNode({{"mesh", 0}});
  doc["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}}}}}};
  for (int i = 0; i < skins; ++i) doc["skins"].push_back({{"joints", std::vector<int>(size_t(joints), 0)}});
  return Text(doc);
}

ByteVector EmptyObjects(uint64_t bytes, const std::string& member) {
  std::string text = R"({"asset":{"version":"2.0"},")" + member + "\":[{}";
  text.reserve(bytes + 16);
  while (text.size() < bytes) text += ",{}";
  text += "]}";
  return {text.begin(), text.end()};
}

}  // namespace voxelpipe::testing
