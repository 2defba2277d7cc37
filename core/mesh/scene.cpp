#include "mesh/scene.h"

namespace voxelpipe {
namespace {

template <typename T>
uint64_t Bytes(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

}  // namespace

uint64_t MorphBytes(const MorphData& morph) {
  uint64_t bytes = Bytes(morph.positions) + Bytes(morph.normals) + Bytes(morph.tangents);
  for (const MorphTarget& target : morph.targets) {
    bytes += Bytes(target.positions) + Bytes(target.normals) + Bytes(target.tangents);
  }
  return bytes;
}

uint64_t PrimitiveBytes(const Primitive& primitive) {
  uint64_t bytes = Bytes(primitive.positions) + Bytes(primitive.normals) + Bytes(primitive.tangents) +
                   Bytes(primitive.colors) + Bytes(primitive.triangles);
  for (int set = 0; set < 2; ++set) {
    bytes += Bytes(primitive.uv[set]) + Bytes(primitive.joints[set]) + Bytes(primitive.weights[set]);
  }
  for (const VertexAttribute& attribute : primitive.attributes) bytes += Bytes(attribute.values);
  return primitive.morph == nullptr ? bytes : bytes + MorphBytes(*primitive.morph);
}

}  // namespace voxelpipe
