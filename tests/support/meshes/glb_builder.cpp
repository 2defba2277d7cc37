#include "support/meshes/glb_builder.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>
#include <stdexcept>

#include "absl/strings/escaping.h"

namespace voxelpipe::testing {
namespace {

using nlohmann::json;

void AppendU32(ByteVector& out, uint64_t value) {
  for (int shift = 0; shift < 32; shift += 8) out.push_back(uint8_t(value >> shift));
}

int Append(json& array, json element) {
  array.push_back(std::move(element));
  return int(array.size()) - 1;
}

uint64_t Components(const std::string& type) {
  static const std::map<std::string, uint64_t> kCounts = {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4},
                                                          {"MAT2", 4},   {"MAT3", 9}, {"MAT4", 16}};
  return kCounts.at(type);
}

}  // namespace

int GlbBuilder::View(const ByteVector& bytes, int stride) {
  while (bin.size() % 4 != 0) bin.push_back(0);
  json view = {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
  if (stride != 0) view["byteStride"] = stride;
  bin.insert(bin.end(), bytes.begin(), bytes.end());
  return Append(doc["bufferViews"], std::move(view));
}

int GlbBuilder::Accessor(int view, int component_type, const std::string& type, uint64_t count, bool normalized) {
  json accessor = {{"componentType", component_type}, {"type", type}, {"count", count}};
  if (view >= 0) accessor["bufferView"] = view;
  if (normalized) accessor["normalized"] = true;
  return Append(doc["accessors"], std::move(accessor));
}

int GlbBuilder::Positions(const std::vector<Vec3f>& values) {
  const int accessor = Accessor(View(AsBytes(values)), kF32, "VEC3", values.size());
  if (values.empty()) return accessor;
  Vec3f least = values[0], most = values[0];
  for (const Vec3f& v : values) {
    for (int a = 0; a < 3; ++a) {
      least[a] = std::min(least[a], v[a]);
      most[a] = std::max(most[a], v[a]);
    }
  }
  doc["accessors"][accessor]["min"] = {least.x, least.y, least.z};
  doc["accessors"][accessor]["max"] = {most.x, most.y, most.z};
  return accessor;
}

int GlbBuilder::Vectors(const std::vector<float>& values, const std::string& type) {
  return Accessor(View(AsBytes(values)), kF32, type, values.size() / Components(type));
}

int GlbBuilder::Indices(const std::vector<uint32_t>& values, int component_type) {
  ByteVector bytes;
  const int size = component_type == kU8 ? 1 : component_type == kU16 ? 2 : 4;
  for (const uint32_t v : values) {
    for (int i = 0; i < size; ++i) bytes.push_back(uint8_t(v >> (8 * i)));
  }
  return Accessor(View(bytes), component_type, "SCALAR", values.size());
}

int GlbBuilder::Mesh(json primitive) {
  return Append(doc["meshes"], {{"primitives", json::array({std::move(primitive)})}});
}

int GlbBuilder::Node(json node) {
  return Append(doc["nodes"], std::move(node));
}

json GlbBuilder::Primitive(const std::vector<Vec3f>& positions, const std::vector<uint32_t>& indices) {
  json primitive = {{"attributes", {{"POSITION", Positions(positions)}}}};
  if (!indices.empty()) primitive["indices"] = Indices(indices);
  return primitive;
}

void GlbBuilder::Scene(std::vector<int> roots) {
  doc["scene"] = Append(doc["scenes"], {{"nodes", std::move(roots)}});
}

ByteVector PackGlb(const std::string& text, const ByteVector& bin) {
  std::string padded = text;
  while (padded.size() % 4 != 0) padded.push_back(' ');
  const size_t bin_size = (bin.size() + 3) / 4 * 4;
  ByteVector out;
  AppendU32(out, 0x46546C67);  // "glTF"
  AppendU32(out, 2);
  AppendU32(out, 12 + 8 + padded.size() + (bin.empty() ? 0 : 8 + bin_size));
  AppendU32(out, padded.size());
  AppendU32(out, 0x4E4F534A);  // "JSON"
  out.insert(out.end(), padded.begin(), padded.end());
  if (bin.empty()) return out;
  AppendU32(out, bin_size);
  AppendU32(out, 0x004E4942);  // "BIN"
  out.insert(out.end(), bin.begin(), bin.end());
  out.resize(out.size() + bin_size - bin.size());
  return out;
}

ByteVector GlbBuilder::Glb() const {
  json copy = doc;
  if (!bin.empty() && !copy.contains("buffers")) copy["buffers"] = json::array({{{"byteLength", bin.size()}}});
  return PackGlb(copy.dump(), bin);
}

ByteVector GlbBuilder::Gltf() const {
  json copy = doc;
  if (!bin.empty() && !copy.contains("buffers")) {
    copy["buffers"] =
        json::array({{{"byteLength", bin.size()}, {"uri", "data:application/octet-stream;base64," + Base64(bin)}}});
  }
  const std::string text = copy.dump();
  return ByteVector(text.begin(), text.end());
}

ByteVector MakeGlb(const std::vector<Vec3f>& positions, const std::vector<uint32_t>& indices) {
  GlbBuilder b;
  b.Scene({b.Node({{"mesh", b.Mesh(b.Primitive(positions, indices))}})});
  return b.Glb();
}

Shape CubeShape(float size) {
  Shape shape;
  for (int i = 0; i < 8; ++i) {
    shape.positions.push_back({float(i & 1) * size, float((i >> 1) & 1) * size, float(i >> 2) * size});
  }
  shape.indices = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                   2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
  return shape;
}

Shape IcosphereShape(int subdivisions) {
  const float t = (1 + std::sqrt(5.f)) / 2;
  Shape shape;
  const auto add = [&](const Vec3f& p) {
    const float length = std::sqrt(Dot(p, p));
    shape.positions.push_back({p.x / length, p.y / length, p.z / length});
    return uint32_t(shape.positions.size() - 1);
  };
  for (const Vec3f& p :
       {Vec3f{-1, t, 0}, Vec3f{1, t, 0}, Vec3f{-1, -t, 0}, Vec3f{1, -t, 0}, Vec3f{0, -1, t}, Vec3f{0, 1, t},
        Vec3f{0, -1, -t}, Vec3f{0, 1, -t}, Vec3f{t, 0, -1}, Vec3f{t, 0, 1}, Vec3f{-t, 0, -1}, Vec3f{-t, 0, 1}}) {
    add(p);
  }
  shape.indices = {0, 11, 5, 0, 5, 1, 0, 1, 7, 0, 7, 10, 0, 10, 11, 1, 5, 9, 5, 11, 4,  11, 10, 2,  10, 7, 6, 7, 1, 8,
                   3, 9,  4, 3, 4, 2, 3, 2, 6, 3, 6, 8,  3, 8,  9,  4, 9, 5, 2, 4,  11, 6,  2,  10, 8,  6, 7, 9, 8, 1};
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [it, is_new] = middles.try_emplace(std::minmax(a, b), 0u);
      if (is_new) it->second = add(shape.positions[a] + shape.positions[b]);
      return it->second;
    };
    std::vector<uint32_t> finer;
    for (size_t i = 0; i < shape.indices.size(); i += 3) {
      const uint32_t a = shape.indices[i], b = shape.indices[i + 1], c = shape.indices[i + 2];
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca});
    }
    shape.indices = std::move(finer);
  }
  return shape;
}

Shape TorusShape(int rings, int segments) {
  Shape shape;
  for (int i = 0; i < rings; ++i) {
    for (int j = 0; j < segments; ++j) {
      const double u = 2 * std::numbers::pi * i / rings, v = 2 * std::numbers::pi * j / segments;
      const double r = 1 + 0.4 * std::cos(v);
      shape.positions.push_back({float(r * std::cos(u)), float(r * std::sin(u)), float(0.4 * std::sin(v))});
      const uint32_t i1 = uint32_t((i + 1) % rings), j1 = uint32_t((j + 1) % segments), n = uint32_t(segments);
      const uint32_t a = uint32_t(i) * n + uint32_t(j), b = i1 * n + uint32_t(j), c = i1 * n + j1,
                     d = uint32_t(i) * n + j1;
      shape.indices.insert(shape.indices.end(), {a, b, c, a, c, d});
    }
  }
  return shape;
}

ByteVector CubeGlb(float size) {
  const Shape s = CubeShape(size);
  return MakeGlb(s.positions, s.indices);
}

ByteVector IcosphereGlb(int subdivisions) {
  const Shape s = IcosphereShape(subdivisions);
  return MakeGlb(s.positions, s.indices);
}

ByteVector TorusGlb(int rings, int segments) {
  const Shape s = TorusShape(rings, segments);
  return MakeGlb(s.positions, s.indices);
}

ByteVector MakePng(uint32_t width, uint32_t height, const ByteVector& rgba) {
  if (rgba.size() != size_t(width) * height * 4) throw std::invalid_argument("MakePng: wrong number of bytes");
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  image.width = width;
  image.height = height;
  image.format = PNG_FORMAT_RGBA;
  png_alloc_size_t size = 0;
  if (!png_image_write_to_memory(&image, nullptr, &size, 0, rgba.data(), 0, nullptr))
    throw std::runtime_error(image.message);
  ByteVector out(size);
  if (!png_image_write_to_memory(&image, out.data(), &size, 0, rgba.data(), 0, nullptr)) {
    throw std::runtime_error(image.message);
  }
  out.resize(size);
  return out;
}

ByteVector TexturedQuadGlb() {
  GlbBuilder b;
  json primitive = b.Primitive({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {0, 1, 2, 0, 2, 3});
  primitive["attributes"]["NORMAL"] = b.Vectors({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  primitive["attributes"]["TEXCOORD_0"] = b.Vectors({0, 1, 1, 1, 1, 0, 0, 0}, "VEC2");
  primitive["material"] = 0;
  const int view = b.View(MakePng(2, 2, {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 255}));
  b.doc["images"] = json::array({{{"bufferView", view}, {"mimeType", "image/png"}}});
  b.doc["samplers"] = json::array({{{"magFilter", 9728}, {"minFilter", 9728}}});
  b.doc["textures"] = json::array({{{"source", 0}, {"sampler", 0}}});
  b.doc["materials"] = json::array({{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}});
  b.Scene({b.Node({{"mesh", b.Mesh(std::move(primitive))}})});
  return b.Glb();
}

std::string Base64(std::span<const uint8_t> bytes) {
  return absl::Base64Escape(absl::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

}  // namespace voxelpipe::testing
