#include "mesh/scene/scene.h"

#include "mesh/scene/scene_bytes.h"

namespace voxelpipe {
namespace {

template <typename T>
uint64_t Bytes(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

}  // namespace

uint64_t FaultBytes(const absl::Status& fault) {
  constexpr uint64_t kStatusBytes = 128;  // beside the text
  return fault.ok() ? 0 : kStatusBytes + fault.message().size();
}

uint64_t AnimationBytes(const Animation& animation) {
  uint64_t bytes = sizeof animation + animation.name.size() + FaultBytes(animation.fault);
  bytes += Bytes(animation.samplers) + Bytes(animation.channels);
  for (const AnimationSampler& sampler : animation.samplers) bytes += Bytes(sampler.times) + Bytes(sampler.values);
  return bytes;
}

uint64_t MorphBytes(const MorphData& morph) {
  uint64_t bytes = Bytes(morph.positions) + Bytes(morph.normals) + Bytes(morph.tangents);
  for (const MorphTarget& target : morph.targets) {
    bytes += sizeof target + FaultBytes(target.fault);
    bytes += Bytes(target.positions) + Bytes(target.normals) + Bytes(target.tangents);
  }
  return bytes;
}

uint64_t PrimitiveBytes(const Primitive& primitive) {
  uint64_t bytes = Bytes(primitive.positions) + Bytes(primitive.double_positions) + Bytes(primitive.normals) +
                   Bytes(primitive.tangents) + Bytes(primitive.colors) + Bytes(primitive.triangles);
  for (int set = 0; set < 2; ++set) {
    bytes += Bytes(primitive.uv[set]) + Bytes(primitive.joints[set]) + Bytes(primitive.weights[set]);
  }
  for (const VertexAttribute& attribute : primitive.attributes) bytes += Bytes(attribute.values);
  return primitive.morph == nullptr ? bytes : bytes + MorphBytes(*primitive.morph);
}

}  // namespace voxelpipe
