// Writes glTF 2.0 files in memory, for tests: valid ones by the methods, malformed ones by editing `doc` and `bin`.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/vec.h"

namespace voxelpipe::testing {

using ByteVector = std::vector<uint8_t>;

// glTF's numbers for component types.
enum ComponentType : int { kI8 = 5120, kU8 = 5121, kI16 = 5122, kU16 = 5123, kU32 = 5125, kF32 = 5126 };

// The bytes of a vector of plain values.
template <typename T>
ByteVector AsBytes(const std::vector<T>& values) {
  const uint8_t* first = reinterpret_cast<const uint8_t*>(values.data());
  return ByteVector(first, first + values.size() * sizeof(T));
}

struct GlbBuilder {
  nlohmann::json doc = {{"asset", {{"version", "2.0"}}}};
  ByteVector bin;

  // Each appends to its array in `doc` (bytes go to `bin`, 4-byte aligned) and returns the new element's index.
  int View(const ByteVector& bytes, int stride = 0);
  int Accessor(int view, int component_type, const std::string& type, uint64_t count, bool normalized = false);
  int Positions(const std::vector<Vec3f>& values);                         // VEC3 FLOAT with min and max
  int Vectors(const std::vector<float>& values, const std::string& type);  // any type of FLOATs
  int Indices(const std::vector<uint32_t>& values, int component_type = kU32);
  int Mesh(nlohmann::json primitive);  // a mesh of this one primitive
  int Node(nlohmann::json node);
  // {"attributes": {"POSITION": ...}, "indices": ...}; no indices if `indices` is empty.
  nlohmann::json Primitive(const std::vector<Vec3f>& positions, const std::vector<uint32_t>& indices = {});
  // Adds scene 0 with these roots and makes it the default.
  void Scene(std::vector<int> roots);

  ByteVector Glb() const;   // with a BIN chunk unless `bin` is empty
  ByteVector Gltf() const;  // text with a data: URI
};

// A GLB of any JSON text and BIN bytes; both are padded to 4 bytes.
ByteVector PackGlb(const std::string& json, const ByteVector& bin);

// A GLB of one node, one mesh, one primitive; not indexed if `indices` is empty.
ByteVector MakeGlb(const std::vector<Vec3f>& positions, const std::vector<uint32_t>& indices = {});

// Plain shapes, outward winding, closed.
struct Shape {
  std::vector<Vec3f> positions;
  std::vector<uint32_t> indices;
};
Shape CubeShape(float size = 1);            // [0, size]^3, 8 vertices, 12 triangles
Shape IcosphereShape(int subdivisions);     // radius 1 at the origin, 20 * 4^subdivisions triangles
Shape TorusShape(int rings, int segments);  // radii 1 and 0.4, 2 * rings * segments triangles

ByteVector CubeGlb(float size = 1);
ByteVector IcosphereGlb(int subdivisions);
ByteVector TorusGlb(int rings, int segments);

// 8-bit RGBA rows from the top, as a PNG file.
ByteVector MakePng(uint32_t width, uint32_t height, const ByteVector& rgba);

// The square [0,1]^2 in z = 0 with normals +z, uv (0,0) at the top left (0,1,0), and a 2x2 PNG as base colour texture,
// nearest filter: red, green / blue, white from the top.
ByteVector TexturedQuadGlb();

std::string Base64(std::span<const uint8_t> bytes);

}  // namespace voxelpipe::testing
