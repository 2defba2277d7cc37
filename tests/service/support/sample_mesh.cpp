#include "service/support/sample_mesh.h"

#include <png.h>

#include <cmath>
#include <cstring>
#include <random>
#include <string>

#include <nlohmann/json.hpp>

namespace voxelpipe::testing {
namespace {

using Json = nlohmann::json;

constexpr int kFloat = 5126, kUnsignedInt = 5125;  // glTF's component types

// Collects the binary chunk together with its buffer views and accessors.
class GlbWriter {
 public:
  GlbWriter() {
    json_ = {{"asset", {{"version", "2.0"}}}, {"bufferViews", Json::array()}, {"accessors", Json::array()}};
  }

  Json& json() { return json_; }

  // Index of the new buffer view.
  int AddView(const void* data, size_t bytes) {
    json_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes}});
    binary_.append(static_cast<const char*>(data), bytes);
    while (binary_.size() % 4 != 0) binary_.push_back('\0');
    return int(json_["bufferViews"].size()) - 1;
  }

  // Index of the new accessor. `values` holds whole elements of the type.
  template <typename T>
  int AddAccessor(const std::vector<T>& values, int component_type, const char* type, size_t components) {
    const int view = AddView(values.data(), values.size() * sizeof(T));
    json_["accessors"].push_back({{"bufferView", view},
                                  {"componentType", component_type},
                                  {"count", values.size() / components},
                                  {"type", type}});
    return int(json_["accessors"].size()) - 1;
  }
  int AddPositions(const std::vector<float>& xyz) {
    const int accessor = AddAccessor(xyz, kFloat, "VEC3", 3);
    std::vector<float> low(xyz.begin(), xyz.begin() + 3), high = low;
    for (size_t i = 0; i < xyz.size(); ++i) {
      low[i % 3] = std::min(low[i % 3], xyz[i]);
      high[i % 3] = std::max(high[i % 3], xyz[i]);
    }
    json_["accessors"][size_t(accessor)]["min"] = low;
    json_["accessors"][size_t(accessor)]["max"] = high;
    return accessor;
  }

  std::vector<uint8_t> Finish() {
    json_["buffers"] = {{{"byteLength", binary_.size()}}};
    std::string text = json_.dump();
    while (text.size() % 4 != 0) text.push_back(' ');
    std::vector<uint8_t> file;
    const auto word = [&](uint32_t value) {
      for (int i = 0; i < 4; ++i) file.push_back(uint8_t(value >> (8 * i)));
    };
    word(0x46546C67);  // "glTF"
    word(2);
    word(uint32_t(12 + 8 + text.size() + 8 + binary_.size()));
    word(uint32_t(text.size()));
    word(0x4E4F534A);  // "JSON"
    file.insert(file.end(), text.begin(), text.end());
    word(uint32_t(binary_.size()));
    word(0x004E4942);  // "BIN"
    file.insert(file.end(), binary_.begin(), binary_.end());
    return file;
  }

 private:
  Json json_;
  std::string binary_;
};

// Side x side texels of seeded noise.
std::vector<uint8_t> NoisePng(unsigned side) {
  std::mt19937 random(5);
  std::vector<uint8_t> rgb(3 * side * side);
  for (uint8_t& value : rgb) value = uint8_t(random());
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = image.height = side;
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t bytes = 0;
  png_image_write_to_memory(&image, nullptr, &bytes, 0, rgb.data(), 0, nullptr);
  std::vector<uint8_t> file(bytes);
  png_image_write_to_memory(&image, file.data(), &bytes, 0, rgb.data(), 0, nullptr);
  return file;
}

}  // namespace

std::vector<uint8_t> TorusGlb(int n) {
  std::vector<float> positions, normals, uv, colors;
  std::vector<uint32_t> indices;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const double u = 2 * M_PI * (i % n) / n, v = 2 * M_PI * (j % n) / n;
      const double ring = 1 + 0.4 * std::cos(v);
      for (double p : {ring * std::cos(u), 0.4 * std::sin(v), ring * std::sin(u)}) positions.push_back(float(p));
      for (double c : {std::cos(v) * std::cos(u), std::sin(v), std::cos(v) * std::sin(u)}) normals.push_back(float(c));
      for (double t : {double(i) / n, double(j) / n}) uv.push_back(float(t));
      for (double c : {0.5 + 0.5 * std::cos(u), 0.25, 0.5 + 0.5 * std::sin(v), 1.0}) colors.push_back(float(c));
    }
  }
  const uint32_t row = uint32_t(n) + 1;
  for (uint32_t i = 0; i < uint32_t(n); ++i) {
    for (uint32_t j = 0; j < uint32_t(n); ++j) {
      const uint32_t a = i * row + j, b = a + 1, c = a + row, d = c + 1;
      for (uint32_t index : {a, b, c, c, b, d}) indices.push_back(index);
    }
  }
  const std::vector<uint8_t> picture = NoisePng(16);

  GlbWriter glb;
  Json attributes;
  attributes["POSITION"] = glb.AddPositions(positions);
  attributes["NORMAL"] = glb.AddAccessor(normals, kFloat, "VEC3", 3);
  attributes["TEXCOORD_0"] = glb.AddAccessor(uv, kFloat, "VEC2", 2);
  attributes["COLOR_0"] = glb.AddAccessor(colors, kFloat, "VEC4", 4);
  const int index_accessor = glb.AddAccessor(indices, kUnsignedInt, "SCALAR", 1);
  Json& json = glb.json();
  json["meshes"] = {{{"primitives", {{{"attributes", attributes}, {"indices", index_accessor}, {"material", 0}}}}}};
  json["images"] = {{{"bufferView", glb.AddView(picture.data(), picture.size())}, {"mimeType", "image/png"}}};
  json["textures"] = {{{"source", 0}}};
  json["materials"] = {
      {{"pbrMetallicRoughness", {{"baseColorFactor", {0.75, 0.5, 1.0, 1.0}}, {"baseColorTexture", {{"index", 0}}}}}}};
  json["nodes"] = {{{"mesh", 0},
                    {"rotation", {0.18257418, 0.36514837, 0.54772256, 0.73029674}},
                    {"scale", {1.5, -1.0, 1.0}},
                    {"translation", {3.0, -2.0, 0.5}}}};
  json["scenes"] = {{{"nodes", {0}}}};
  json["scene"] = 0;
  return glb.Finish();
}

std::vector<uint8_t> LargeTrianglesGlb(int count) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> in_cube(0, 1);
  std::vector<float> positions(size_t(count) * 9);
  for (float& value : positions) value = in_cube(random);
  GlbWriter glb;
  const int accessor = glb.AddPositions(positions);
  Json& json = glb.json();
  json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", accessor}}}}}}}};
  json["nodes"] = {{{"mesh", 0}}};
  json["scenes"] = {{{"nodes", {0}}}};
  json["scene"] = 0;
  return glb.Finish();
}

}  // namespace voxelpipe::testing
