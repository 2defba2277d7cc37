// Source: glTF 2.0 specification, sections 3.5.2 (transformations), 3.7.3 (skins), 3.11 (animations).
#include "mesh/scene/pose.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr char kWhat[] = "the mesh's pose";
constexpr size_t kPartsAStep = 4096;  // nodes or parts between two polls of the job

// Locals and morph weights of the nodes in the pose.
struct NodeState {
  std::vector<Mat4d> local;
  std::vector<std::vector<double>> weights;
};

uint64_t TargetsOf(const RigPart& part) {
  return part.primitive->morph == nullptr ? 0 : part.primitive->morph->targets.size();
}

// Bytes of the state of the nodes with the file's weights, and of a pose without morph weights.
uint64_t StateBytes(const Rig& rig) {
  uint64_t bytes = rig.nodes.size() * (3 * sizeof(Mat4d) + sizeof(std::vector<double>));
  for (const RigNode& node : rig.nodes) bytes += node.weights.size() * sizeof(double);
  return bytes;
}
uint64_t PoseBytes(const Rig& rig) {
  uint64_t bytes = rig.parts.size() * sizeof(PoseView);
  for (const Skin& skin : rig.skins) bytes += sizeof(std::vector<Mat4d>) + skin.joints.size() * sizeof(Mat4d);
  return bytes;
}

absl::Status Animate(const JobContext& job, const Rig& rig, const PoseQuery& query, MemoryCharge& charge,
                     NodeState& state) {
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
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const AnimationSampler& sampler = animation.samplers[channel.sampler];
    if (channel.path == AnimationPath::kWeights) {
      if (absl::Status full = charge.Grow(sampler.width, sizeof(double), kWhat); !full.ok()) return full;
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

absl::Status SetWeights(const JobContext& job, const Rig& rig, const std::vector<double>& weights, MemoryCharge& charge,
                        NodeState& state) {
  uint64_t most = 0;
  for (const RigPart& part : rig.parts) most = std::max(most, TargetsOf(part));
  if (weights.size() > most) {
    return absl::InvalidArgumentError(absl::StrCat("weights: ", weights.size(), " given, the mesh has ", most,
                                                   most == 1 ? " morph target" : " morph targets"));
  }
  if (absl::Status full = charge.Grow(state.weights.size(), weights.size() * sizeof(double), kWhat); !full.ok()) {
    return full;
  }
  for (std::vector<double>& w : state.weights) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    w = weights;
  }
  return absl::OkStatus();
}

// Adds a list of weights, one a target, from the given ones. Out: its address, valid while the pose lives.
absl::StatusOr<const double*> AddWeights(const JobContext& job, const std::vector<MorphTarget>& targets,
                                         const std::vector<double>& given, Pose& pose) {
  if (absl::Status over = job.Check(); !over.ok()) return over;
  const uint64_t bytes = targets.size() * sizeof(double) + 2 * sizeof(std::vector<double>);  // lists grow by doubling
  if (absl::Status full = pose.memory.Grow(bytes, kWhat); !full.ok()) return full;
  std::vector<double> weights(targets.size());
  std::copy_n(given.begin(), std::min(given.size(), weights.size()), weights.begin());
  for (size_t t = 0; t < weights.size(); ++t) {
    if (weights[t] != 0 && !targets[t].fault.ok()) return targets[t].fault;
  }
  return pose.target_weights.emplace_back(std::move(weights)).data();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Pose>> EvaluatePose(const Rig& rig, const PoseQuery& query) {
  const JobContext endless;
  return EvaluatePoseFor(endless, rig, query);
}

absl::StatusOr<std::unique_ptr<Pose>> EvaluatePoseFor(const JobContext& job, const Rig& rig, const PoseQuery& query) {
  MemoryCharge working(&MemoryOf(job));
  if (absl::Status full = working.Grow(StateBytes(rig), kWhat); !full.ok()) return full;
  NodeState state;
  state.local.reserve(rig.nodes.size());
  state.weights.reserve(rig.nodes.size());
  for (const RigNode& node : rig.nodes) {
    if (state.local.size() % kPartsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    state.local.push_back(node.local);
    state.weights.push_back(node.weights);
  }
  if (query.animation) {
    if (absl::Status s = Animate(job, rig, query, working, state); !s.ok()) return s;
  }
  if (query.weights) {
    if (absl::Status s = SetWeights(job, rig, *query.weights, working, state); !s.ok()) return s;
  }
  std::vector<Mat4d> world(rig.nodes.size());
  for (const uint32_t n : rig.order) {
    const int64_t parent = rig.nodes[n].parent;
    world[n] = parent < 0 ? state.local[n] : Multiply(world[size_t(parent)], state.local[n]);
  }
  auto pose = std::make_unique<Pose>();
  pose->memory = MemoryCharge(&MemoryOf(job));
  if (absl::Status full = pose->memory.Grow(PoseBytes(rig), kWhat); !full.ok()) return full;
  for (const Skin& skin : rig.skins) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    std::vector<Mat4d>& matrices = pose->skins.emplace_back();
    matrices.reserve(skin.joints.size());
    for (size_t j = 0; j < skin.joints.size(); ++j) {
      matrices.push_back(Multiply(world[skin.joints[j]], skin.inverse_bind_matrices[j]));
    }
  }
  // For each primitive with morph targets: the last node that has it, and the weights there. The parts of a node are
  // consecutive.
  std::unordered_map<const Primitive*, std::pair<uint32_t, const double*>> last;
  pose->parts.reserve(rig.parts.size());
  for (size_t i = 0; i < rig.parts.size(); ++i) {
    if (i % kPartsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const RigPart& part = rig.parts[i];
    PoseView view;
    if (const uint64_t targets = TargetsOf(part); targets > 0) {
      auto& [node, shared] = last[part.primitive.get()];
      if (shared == nullptr || node != part.node) {
        const absl::StatusOr<const double*> weights =
            AddWeights(job, part.primitive->morph->targets, state.weights[part.node], *pose);
        if (!weights.ok()) return weights.status();
        node = part.node;
        shared = *weights;
      }
      view.target_weights = shared;
    }
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
  targets.reserve(morph->targets.size());
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
