#include "support/meshes/compressed_meshes.h"

#include <cstdio>  // jpeglib.h needs FILE
#include <cstdlib>

#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#include <jpeglib.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <stdexcept>

#include "support/meshes/draco_vectors.h"

namespace voxelpipe::testing {
namespace {

using nlohmann::json;

struct Stream {
  ByteVector bytes;
  int position_id = 0;
};

Stream EncodeDraco(const Shape& shape, bool normals) {
  draco::Mesh mesh;
  mesh.set_num_points(uint32_t(shape.positions.size()));
  mesh.SetNumFaces(shape.indices.size() / 3);
  for (size_t f = 0; f < shape.indices.size() / 3; ++f) {
    draco::Mesh::Face face;
    for (int i = 0; i < 3; ++i) face[size_t(i)] = draco::PointIndex(shape.indices[3 * f + size_t(i)]);
    mesh.SetFace(draco::FaceIndex(uint32_t(f)), face);
  }
  Stream stream;
  const int position = AddVectors(mesh, draco::GeometryAttribute::POSITION, shape.positions);
  stream.position_id = int(mesh.attribute(position)->unique_id());
  if (normals) AddVectors(mesh, draco::GeometryAttribute::NORMAL, shape.positions);  // not unit: that is not asked for
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 14);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok()) throw std::runtime_error("Draco does not encode");
  stream.bytes.assign(buffer.data(), buffer.data() + buffer.size());
  return stream;
}

// An accessor whose bytes are elsewhere.
int Placeholder(GlbBuilder& glb, int component_type, const std::string& type, uint64_t count) {
  glb.doc["accessors"].push_back({{"componentType", component_type}, {"type", type}, {"count", count}});
  return int(glb.doc["accessors"].size()) - 1;
}

void AddBounds(GlbBuilder& glb, int accessor, const std::vector<Vec3f>& positions) {
  Vec3f low = positions.at(0), high = low;
  for (const Vec3f& p : positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  glb.doc["accessors"][size_t(accessor)]["min"] = {low.x, low.y, low.z};
  glb.doc["accessors"][size_t(accessor)]["max"] = {high.x, high.y, high.z};
}

// A view whose `encoded` bytes stand for count * stride others.
int MeshoptView(GlbBuilder& glb, const ByteVector& encoded, uint64_t count, int stride, const char* mode) {
  const int view = glb.View(encoded);
  json& object = glb.doc["bufferViews"][size_t(view)];
  object["extensions"]["EXT_meshopt_compression"] = {{"buffer", 0},
                                                     {"byteOffset", object.value("byteOffset", 0)},
                                                     {"byteLength", encoded.size()},
                                                     {"byteStride", stride},
                                                     {"count", count},
                                                     {"mode", mode}};
  object["buffer"] = 1;  // a placeholder: readers without the extension find nothing there
  object["byteOffset"] = 0;
  object["byteLength"] = count * uint64_t(stride);
  if (mode == std::string("ATTRIBUTES")) object["byteStride"] = stride;
  return view;
}

}  // namespace

ByteVector DracoFile(const Shape& shape, bool normals) {
  return EncodeDraco(shape, normals).bytes;
}

ByteVector DracoGlb(const Shape& shape) {
  const Stream stream = EncodeDraco(shape, false);
  GlbBuilder glb;
  const int view = glb.View(stream.bytes);
  const int positions = Placeholder(glb, kF32, "VEC3", shape.positions.size());
  AddBounds(glb, positions, shape.positions);
  const int indices = Placeholder(glb, kU32, "SCALAR", shape.indices.size());
  json primitive = {{"attributes", {{"POSITION", positions}}}, {"indices", indices}};
  primitive["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", view},
                                                           {"attributes", {{"POSITION", stream.position_id}}}};
  glb.Scene({glb.Node({{"mesh", glb.Mesh(primitive)}})});
  glb.doc["extensionsUsed"] = glb.doc["extensionsRequired"] = json::array({"KHR_draco_mesh_compression"});
  return glb.Glb();
}

ByteVector MeshoptGlb(const Shape& shape) {
  const size_t vertices = shape.positions.size();
  ByteVector attributes(meshopt_encodeVertexBufferBound(vertices, sizeof(Vec3f)));
  attributes.resize(meshopt_encodeVertexBuffer(attributes.data(), attributes.size(), shape.positions.data(), vertices,
                                               sizeof(Vec3f)));
  ByteVector triangles(meshopt_encodeIndexBufferBound(shape.indices.size(), vertices));
  triangles.resize(
      meshopt_encodeIndexBuffer(triangles.data(), triangles.size(), shape.indices.data(), shape.indices.size()));
  GlbBuilder glb;
  const int vertex_view = MeshoptView(glb, attributes, vertices, sizeof(Vec3f), "ATTRIBUTES");
  const int index_view = MeshoptView(glb, triangles, shape.indices.size(), sizeof(uint32_t), "TRIANGLES");
  const int positions = glb.Accessor(vertex_view, kF32, "VEC3", vertices);
  AddBounds(glb, positions, shape.positions);
  const int indices = glb.Accessor(index_view, kU32, "SCALAR", shape.indices.size());
  glb.Scene({glb.Node({{"mesh", glb.Mesh({{"attributes", {{"POSITION", positions}}}, {"indices", indices}})}})});
  const uint64_t placeholder = vertices * sizeof(Vec3f) + shape.indices.size() * sizeof(uint32_t);
  glb.doc["buffers"] =
      json::array({{{"byteLength", glb.bin.size()}},
                   {{"byteLength", placeholder}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}});
  glb.doc["extensionsUsed"] = glb.doc["extensionsRequired"] = json::array({"EXT_meshopt_compression"});
  return glb.Glb();
}

ByteVector JpegQuadGlb(int width, int height) {
  jpeg_compress_struct jpeg;
  jpeg_error_mgr errors;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* out = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
  jpeg_mem_dest(&jpeg, &out, &size);
  jpeg.image_width = JDIMENSION(width);
  jpeg.image_height = JDIMENSION(height);
  jpeg.input_components = 3;
  jpeg.in_color_space = JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  ByteVector row(size_t(width) * 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      row[size_t(x) * 3] = uint8_t(x * 255 / width);
      row[size_t(x) * 3 + 1] = uint8_t(y * 255 / height);
      row[size_t(x) * 3 + 2] = 128;
    }
    JSAMPROW rows[1] = {row.data()};
    jpeg_write_scanlines(&jpeg, rows, 1);
  }
  jpeg_finish_compress(&jpeg);
  const ByteVector file(out, out + size);
  jpeg_destroy_compress(&jpeg);
  std::free(out);

  GlbBuilder glb;
  json primitive = glb.Primitive({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {0, 1, 2, 0, 2, 3});
  primitive["attributes"]["TEXCOORD_0"] = glb.Vectors({0, 1, 1, 1, 1, 0, 0, 0}, "VEC2");
  glb.doc["images"] = {{{"bufferView", glb.View(file)}, {"mimeType", "image/jpeg"}}};
  glb.doc["textures"] = {{{"source", 0}}};
  glb.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  primitive["material"] = 0;
  glb.Scene({glb.Node({{"mesh", glb.Mesh(primitive)}})});
  return glb.Glb();
}

}  // namespace voxelpipe::testing
