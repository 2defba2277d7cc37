// Source: glTF 2.0 specification, sections 3.5.2 (transformations), 3.7.3 (skins), 3.11 (animations).
#include "mesh/pose.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

// Locals and morph weights of the nodes in the pose.
struct NodeState {
  std::vector<Mat4d> local;
  std::vector<std::vector<double>> weights;
};

absl::Status Animate(const Rig& rig, const PoseQuery& query, NodeState& state) {
  if (*query.animation >= rig.animations.size()) {
    return absl::InvalidArgumentError(absl::StrCat("animation ", *query.animation, " does not exist: the file has ",
                                                   rig.animations.size(), " animations"));
  }
  const Animation& animation = rig.animations[*query.animation];
  if (!animation.fault.ok()) return animation.fault;
  std::vector<Trs> trs(rig.nodes.size());
  for (size_t n = 0; n < trs.size(); ++n) trs[n] = rig.nodes[n].trs;
  std::vector<bool> moved(rig.nodes.size());
  for (const AnimationChannel& channel : animation.channels) {
    const AnimationSampler& sampler = animation.samplers[channel.sampler];
    if (channel.path == AnimationPath::kWeights) {
      state.weights[channel.node].resize(sampler.width);
      SampleAnimation(sampler, false, query.time, state.weights[channel.node].data());
      continue;
    }
    double v[4] = {};
    SampleAnimation(sampler, channel.path == AnimationPath::kRotation, query.time, v);
    Trs& to = trs[channel.node];
    if (channel.path == AnimationPath::kTranslation) to.translation = {v[0], v[1], v[2]};
    if (channel.path == AnimationPath::kRotation) to.rotation = {v[0], v[1], v[2], v[3]};
    if (channel.path == AnimationPath::kScale) to.scale = {v[0], v[1], v[2]};
    moved[channel.node] = true;
  }
  for (size_t n = 0; n < trs.size() && query.nodes; ++n) {
    if (moved[n]) state.local[n] = FromTrs(trs[n]);
  }
  return absl::OkStatus();
}

absl::Status SetWeights(const Rig& rig, const std::vector<double>& weights, NodeState& state) {
  size_t most = 0;
  for (const RigPart& part : rig.parts) {
    if (part.primitive->morph != nullptr) most = std::max(most, part.primitive->morph->targets.size());
  }
  if (weights.size() > most) {
    return absl::InvalidArgumentError(absl::StrCat("weights: ", weights.size(), " given, the mesh has ", most,
                                                   most == 1 ? " morph target" : " morph targets"));
  }
  for (std::vector<double>& w : state.weights) w = weights;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Pose>> EvaluatePose(const Rig& rig, const PoseQuery& query) {
  NodeState state;
  for (const RigNode& node : rig.nodes) {
    state.local.push_back(node.local);
    state.weights.push_back(node.weights);
  }
  if (query.animation) {
    if (absl::Status s = Animate(rig, query, state); !s.ok()) return s;
  }
  if (query.weights) {
    if (absl::Status s = SetWeights(rig, *query.weights, state); !s.ok()) return s;
  }
  std::vector<Mat4d> world(rig.nodes.size());
  for (const uint32_t n : rig.order) {
    const int64_t parent = rig.nodes[n].parent;
    world[n] = parent < 0 ? state.local[n] : Multiply(world[size_t(parent)], state.local[n]);
  }
  auto pose = std::make_unique<Pose>();
  for (const Skin& skin : rig.skins) {
    std::vector<Mat4d>& matrices = pose->skins.emplace_back();
    for (size_t j = 0; j < skin.joints.size(); ++j) {
      matrices.push_back(Multiply(world[skin.joints[j]], skin.inverse_bind_matrices[j]));
    }
  }
  for (size_t i = 0; i < rig.parts.size(); ++i) {
    const RigPart& part = rig.parts[i];
    const size_t targets = part.primitive->morph == nullptr ? 0 : part.primitive->morph->targets.size();
    std::vector<double>& weights = pose->target_weights.emplace_back(targets);
    const std::vector<double>& given = state.weights[part.node];
    std::copy_n(given.begin(), std::min(given.size(), targets), weights.begin());
    for (size_t t = 0; t < targets; ++t) {
      const absl::Status& fault = part.primitive->morph->targets[t].fault;
      if (weights[t] != 0 && !fault.ok()) return fault;
    }
    PoseView view;
    view.target_weights = weights.data();  // moving the outer vector keeps the inner ones where they are
    if (part.skin >= 0) {
      view.joints = pose->skins[size_t(part.skin)].data();
      view.joint_count = uint32_t(pose->skins[size_t(part.skin)].size());
      view.mirrored = Determinant3(view.joints[0]) < 0;
    } else {
      view.world = Multiply(world[part.node], part.instance);
      view.mirrored = Determinant3(view.world) < 0;
    }
    pose->parts.push_back(view);
  }
  return pose;
}

RestPrimitiveView RestView(const Primitive& primitive, std::vector<MorphTargetView>& targets) {
  const MorphData* morph = primitive.morph.get();
  const auto& positions = morph != nullptr ? morph->positions : primitive.positions;
  const auto& normals = morph != nullptr ? morph->normals : primitive.normals;
  const auto& tangents = morph != nullptr ? morph->tangents : primitive.tangents;
  RestPrimitiveView view;
  view.positions = positions.data();
  view.normals = normals.empty() ? nullptr : normals.data();
  view.tangents = tangents.empty() ? nullptr : tangents.data();
  for (int set = 0; set < 2; ++set) {
    if (primitive.joints[set].empty() || primitive.weights[set].empty()) continue;
    view.joints[set] = reinterpret_cast<const uint16_t(*)[4]>(primitive.joints[set].data());
    view.weights[set] = reinterpret_cast<const float(*)[4]>(primitive.weights[set].data());
  }
  targets.clear();
  if (morph == nullptr) return view;
  for (const MorphTarget& target : morph->targets) {
    targets.push_back({target.positions.empty() ? nullptr : target.positions.data(),
                       target.normals.empty() ? nullptr : target.normals.data(),
                       target.tangents.empty() ? nullptr : target.tangents.data()});
  }
  view.targets = targets.data();
  view.target_count = uint32_t(targets.size());
  return view;
}

}  // namespace voxelpipe
