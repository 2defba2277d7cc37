#include "isolate/rig_fields.h"

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "isolate/mesh_fields.h"

namespace voxelpipe {
namespace {

// Shared objects: each once, in the order of first use, and the index of each user.
template <typename T>
struct Shared {
  std::vector<std::shared_ptr<T>> objects;
  std::map<const T*, uint32_t> numbers;

  // kNone for null.
  uint32_t NumberOf(const std::shared_ptr<T>& object) {
    if (object == nullptr) return kNone;
    const auto [at, fresh] = numbers.try_emplace(object.get(), uint32_t(objects.size()));
    if (fresh) objects.push_back(object);
    return at->second;
  }
  static constexpr uint32_t kNone = UINT32_MAX;
};

template <typename A, typename T>
void TargetFields(A& archive, T& target) {
  archive.Array(target.positions);
  archive.Array(target.normals);
  archive.Array(target.tangents);
  Fields(archive, target.fault);
}

template <typename A, typename M>
void MorphFields(A& archive, M& morph) {
  archive.Array(morph.positions);
  archive.Array(morph.normals);
  archive.Array(morph.tangents);
  archive.Each(morph.targets, 28, [](A& a, auto& target) { TargetFields(a, target); });
}

// The parts of a primitive in a rig; its triangles and its other attributes are those of the mesh.
template <typename A, typename P>
void PrimitiveFields(A& archive, P& primitive) {
  archive.Array(primitive.positions);
  archive.Array(primitive.normals);
  archive.Array(primitive.tangents);
  for (int set = 0; set < 2; ++set) {
    archive.Array(primitive.joints[set]);
    archive.Array(primitive.weights[set]);
  }
}

template <typename A, typename N>
void NodeFields(A& archive, N& node) {
  archive.Value(node.local);
  archive.Value(node.trs);
  archive.Value(node.parent);
  archive.Array(node.weights);
}

template <typename A, typename S>
void SamplerFields(A& archive, S& sampler) {
  archive.Enum(sampler.interpolation, Interpolation::kCubicSpline);
  archive.Array(sampler.times);
  archive.Array(sampler.values);
  archive.Value(sampler.width);
}

template <typename A, typename N>
void AnimationFields(A& archive, N& animation) {
  archive.Text(animation.name);
  Fields(archive, animation.fault);
  archive.Each(animation.samplers, 21, [](A& a, auto& sampler) { SamplerFields(a, sampler); });
  archive.Each(animation.channels, 9, [](A& a, auto& channel) {
    a.Value(channel.node);
    a.Enum(channel.path, AnimationPath::kWeights);
    a.Value(channel.sampler);
  });
}

template <typename A, typename R>
void NodesOf(A& archive, R& rig) {
  archive.Each(rig.nodes, sizeof(Mat4d), [](A& a, auto& node) { NodeFields(a, node); });
  archive.Array(rig.order);
  archive.Each(rig.skins, 16, [](A& a, auto& skin) {
    a.Array(skin.joints);
    a.Array(skin.inverse_bind_matrices);
  });
  archive.Each(rig.animations, 28, [](A& a, auto& animation) { AnimationFields(a, animation); });
}

void PartFields(ArchiveWriter& archive, const RigPart& part, uint32_t primitive) {
  archive.Value(primitive);
  archive.Value(part.node);
  archive.Value(part.skin);
  archive.Value(part.instance);
}

}  // namespace

void RigFields(ArchiveWriter& archive, const std::shared_ptr<const Rig>& rig) {
  archive.Flag(rig != nullptr);
  if (rig == nullptr) return;
  NodesOf(archive, *rig);
  Shared<const Primitive> primitives;
  Shared<const MorphData> morphs;
  for (const RigPart& part : rig->parts) primitives.NumberOf(part.primitive);
  for (const auto& primitive : primitives.objects) morphs.NumberOf(primitive->morph);
  archive.Each(morphs.objects, 32, [](ArchiveWriter& a, const auto& morph) { MorphFields(a, *morph); });
  archive.Each(primitives.objects, 60, [&](ArchiveWriter& a, const auto& primitive) {
    PrimitiveFields(a, *primitive);
    a.Value(morphs.NumberOf(primitive->morph));
  });
  archive.Each(rig->parts, sizeof(Mat4d), [&](ArchiveWriter& a, const RigPart& part) {
    PartFields(a, part, primitives.NumberOf(part.primitive));
  });
}

void RigFields(ArchiveReader& archive, std::shared_ptr<const Rig>& rig) {
  bool there = false;
  archive.Flag(there);
  if (!there || !archive.ok()) return;
  const auto fresh = std::make_shared<Rig>();
  rig = fresh;
  NodesOf(archive, *fresh);
  // The addresses of the objects are stable: arrays are filled later.
  std::vector<std::shared_ptr<MorphData>> morphs;
  std::vector<std::shared_ptr<Primitive>> primitives;
  archive.Each(morphs, 32, [](ArchiveReader& a, std::shared_ptr<MorphData>& morph) {
    morph = std::make_shared<MorphData>();
    MorphFields(a, *morph);
  });
  archive.Each(primitives, 60, [&](ArchiveReader& a, std::shared_ptr<Primitive>& primitive) {
    primitive = std::make_shared<Primitive>();
    PrimitiveFields(a, *primitive);
    uint32_t morph = 0;
    a.Value(morph);
    if (morph == Shared<MorphData>::kNone) return;
    if (morph >= morphs.size()) return a.Refuse("morph data that is not there");
    primitive->morph = morphs[morph];
  });
  archive.Each(fresh->parts, sizeof(Mat4d), [&](ArchiveReader& a, RigPart& part) {
    uint32_t primitive = 0;
    a.Value(primitive);
    a.Value(part.node);
    a.Value(part.skin);
    a.Value(part.instance);
    if (primitive >= primitives.size()) return a.Refuse("a primitive that is not there");
    part.primitive = primitives[primitive];
  });
}

}  // namespace voxelpipe
