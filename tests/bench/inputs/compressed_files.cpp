#include "bench/inputs/compressed_files.h"

#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "support/meshes/draco_vectors.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe::bench {
namespace {

using nlohmann::json;
using testing::AddVectors;
using testing::GlbBuilder;

constexpr double kSteps = 65535;

// The vertices in the order in which triangles use them, as tools leave them: codecs count on it.
struct Ordered {
  std::vector<Vec3f> positions, normals;
  std::vector<uint32_t> indices;
};

Ordered InOrderOfUse(const TriangleMesh& mesh) {
  std::vector<uint32_t> indices;
  for (const auto& triangle : mesh.triangles) indices.insert(indices.end(), triangle.begin(), triangle.end());
  const size_t vertices = mesh.positions.size();
  meshopt_optimizeVertexCache(indices.data(), indices.data(), indices.size(), vertices);
  std::vector<uint32_t> to(vertices);
  const size_t used = meshopt_optimizeVertexFetchRemap(to.data(), indices.data(), indices.size(), vertices);
  Ordered ordered{std::vector<Vec3f>(used), std::vector<Vec3f>(used), std::move(indices)};
  for (size_t v = 0; v < vertices; ++v) {
    if (to[v] == UINT32_MAX) continue;
    const Vec3d& p = mesh.positions[v];
    ordered.positions[to[v]] = {float(p.x), float(p.y), float(p.z)};
    ordered.normals[to[v]] = mesh.normals.at(v);
  }
  for (uint32_t& index : ordered.indices) index = to[index];
  return ordered;
}

// Adds a compressed view of count * stride bytes in the placeholder buffer, behind `offset`, which moves on.
int AddView(GlbBuilder& glb, const std::vector<uint8_t>& encoded, uint64_t count, int stride, const char* mode,
            const char* filter, uint64_t& offset) {
  const int view = glb.View(encoded);
  json& object = glb.doc["bufferViews"][size_t(view)];
  json& extension = object["extensions"]["EXT_meshopt_compression"];
  extension = {{"buffer", 0},
               {"byteOffset", object.value("byteOffset", 0)},
               {"byteLength", encoded.size()},
               {"byteStride", stride},
               {"count", count},
               {"mode", mode}};
  if (filter != nullptr) extension["filter"] = filter;
  object["buffer"] = 1;  // a placeholder: readers without the extension find nothing there
  object["byteOffset"] = offset;
  object["byteLength"] = count * uint64_t(stride);
  if (mode == std::string("ATTRIBUTES")) object["byteStride"] = stride;
  offset += count * uint64_t(stride);
  return view;
}

template <typename T>
std::vector<uint8_t> EncodeVertices(const std::vector<T>& values) {
  std::vector<uint8_t> bytes(meshopt_encodeVertexBufferBound(values.size(), sizeof(T)));
  bytes.resize(meshopt_encodeVertexBuffer(bytes.data(), bytes.size(), values.data(), values.size(), sizeof(T)));
  return bytes;
}

}  // namespace

std::vector<uint8_t> QuantizedGlbBytes(const TriangleMesh& mesh) {
  const Ordered ordered = InOrderOfUse(mesh);
  const size_t vertices = ordered.positions.size();
  std::vector<std::array<uint16_t, 4>> positions;
  std::array<int, 3> least{65535, 65535, 65535}, most{0, 0, 0};
  for (const Vec3f& p : ordered.positions) {  // in [0, 1]^3, as the generated meshes are
    std::array<uint16_t, 4> quantized{};
    for (int a = 0; a < 3; ++a) {
      const int step = int(std::lround(std::clamp(double(p[a]), 0.0, 1.0) * kSteps));
      quantized[size_t(a)] = uint16_t(step);
      least[size_t(a)] = std::min(least[size_t(a)], step);
      most[size_t(a)] = std::max(most[size_t(a)], step);
    }
    positions.push_back(quantized);
  }
  std::vector<std::array<float, 4>> unit;
  for (const Vec3f& n : ordered.normals) unit.push_back({n.x, n.y, n.z, 0});
  std::vector<std::array<int8_t, 4>> normals(vertices);
  meshopt_encodeFilterOct(normals.data(), vertices, 4, 8, unit[0].data());
  std::vector<uint8_t> indices(meshopt_encodeIndexBufferBound(ordered.indices.size(), vertices));
  indices.resize(
      meshopt_encodeIndexBuffer(indices.data(), indices.size(), ordered.indices.data(), ordered.indices.size()));

  GlbBuilder glb;
  uint64_t plain = 0;
  const int position_view = AddView(glb, EncodeVertices(positions), vertices, 8, "ATTRIBUTES", nullptr, plain);
  const int normal_view = AddView(glb, EncodeVertices(normals), vertices, 4, "ATTRIBUTES", "OCTAHEDRAL", plain);
  const int index_view = AddView(glb, indices, ordered.indices.size(), 4, "TRIANGLES", nullptr, plain);
  json primitive;
  const int position = glb.Accessor(position_view, testing::kU16, "VEC3", vertices);
  glb.doc["accessors"][size_t(position)]["min"] = least;
  glb.doc["accessors"][size_t(position)]["max"] = most;
  primitive["attributes"]["POSITION"] = position;
  primitive["attributes"]["NORMAL"] = glb.Accessor(normal_view, testing::kI8, "VEC3", vertices, true);
  primitive["indices"] = glb.Accessor(index_view, testing::kU32, "SCALAR", ordered.indices.size());
  const double scale = 1 / kSteps;
  glb.Scene({glb.Node({{"mesh", glb.Mesh(primitive)}, {"scale", {scale, scale, scale}}})});
  glb.doc["buffers"] =
      json::array({{{"byteLength", glb.bin.size()}},
                   {{"byteLength", plain}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}});
  glb.doc["extensionsUsed"] = glb.doc["extensionsRequired"] =
      json::array({"KHR_mesh_quantization", "EXT_meshopt_compression"});
  return glb.Glb();
}

std::vector<uint8_t> DracoBytes(const TriangleMesh& mesh) {
  const Ordered ordered = InOrderOfUse(mesh);
  draco::Mesh out;
  out.set_num_points(uint32_t(ordered.positions.size()));
  out.SetNumFaces(ordered.indices.size() / 3);
  for (size_t f = 0; f < ordered.indices.size() / 3; ++f) {
    draco::Mesh::Face face;
    for (size_t i = 0; i < 3; ++i) face[i] = draco::PointIndex(ordered.indices[3 * f + i]);
    out.SetFace(draco::FaceIndex(uint32_t(f)), face);
  }
  AddVectors(out, draco::GeometryAttribute::POSITION, ordered.positions);
  AddVectors(out, draco::GeometryAttribute::NORMAL, ordered.normals);
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 14);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::NORMAL, 10);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeMeshToBuffer(out, &buffer).ok()) throw std::runtime_error("Draco does not encode");
  return {buffer.data(), buffer.data() + buffer.size()};
}

}  // namespace voxelpipe::bench
