#include <algorithm>
#include <memory>
#include <unordered_map>
#include <utility>

#include "mesh/placement.h"
#include "mesh/scene/scene_bytes.h"

namespace voxelpipe {
namespace {

// Bytes that a rig takes beside its primitives.
uint64_t RigBytes(const Scene& scene, uint64_t placements) {
  uint64_t bytes = placements * sizeof(RigPart) + scene.nodes.size() * (sizeof(RigNode) + sizeof(uint32_t));
  for (const Skin& skin : scene.skins) bytes += skin.joints.size() * (sizeof(uint32_t) + sizeof(Mat4d));
  for (const Animation& animation : scene.animations) bytes += AnimationBytes(animation);
  for (const Node& node : scene.nodes) {
    if (node.mesh >= 0) bytes += scene.meshes[size_t(node.mesh)].weights.size() * sizeof(double);
  }
  return bytes;
}

// The parts of a primitive that a rig needs.
std::shared_ptr<const Primitive> RigCopy(const Primitive& from) {
  auto fresh = std::make_shared<Primitive>();
  if (from.morph == nullptr) {  // the morph data holds the unposed attributes
    fresh->positions = from.positions;
    fresh->normals = from.normals;
    fresh->tangents = from.tangents;
  }
  for (int set = 0; set < 2; ++set) {
    fresh->joints[set] = from.joints[set];
    fresh->weights[set] = from.weights[set];
  }
  fresh->morph = from.morph;
  return fresh;
}

}  // namespace

absl::Status MakeRig(const JobContext& job, const Scene& scene, const std::vector<Placement>& placements,
                     TriangleMesh& mesh) {
  const bool morphs = std::any_of(placements.begin(), placements.end(),
                                  [](const Placement& p) { return p.primitive->morph != nullptr; });
  if (scene.animations.empty() && !morphs) return absl::OkStatus();
  constexpr char kWhat[] = "the mesh's rig";
  if (absl::Status full = mesh.memory->Grow(RigBytes(scene, placements.size()), kWhat); !full.ok()) return full;
  auto rig = std::make_shared<Rig>();
  rig->skins = scene.skins;
  rig->animations.reserve(scene.animations.size());
  for (const Animation& animation : scene.animations) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    rig->animations.push_back(animation);
  }
  rig->nodes.resize(scene.nodes.size());
  std::vector<uint32_t> stack;
  for (size_t n = 0; n < scene.nodes.size(); ++n) {
    if (n % kPlacementsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const Node& node = scene.nodes[n];
    rig->nodes[n].local = node.local;
    rig->nodes[n].trs = node.trs;
    if (node.mesh >= 0) rig->nodes[n].weights = scene.meshes[size_t(node.mesh)].weights;
    for (const uint32_t child : node.children) rig->nodes[child].parent = int64_t(n);
  }
  for (size_t n = 0; n < scene.nodes.size(); ++n) {
    if (rig->nodes[n].parent < 0) stack.push_back(uint32_t(n));
  }
  while (!stack.empty()) {
    const uint32_t n = stack.back();
    stack.pop_back();
    rig->order.push_back(n);
    stack.insert(stack.end(), scene.nodes[n].children.begin(), scene.nodes[n].children.end());
  }
  rig->parts.reserve(placements.size());
  std::unordered_map<const Primitive*, std::shared_ptr<const Primitive>> copies;
  for (size_t i = 0; i < placements.size(); ++i) {
    if (i % kPlacementsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const Placement& p = placements[i];
    std::shared_ptr<const Primitive>& copy = copies[p.primitive];
    if (copy == nullptr) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
      // The shared data outlives the scene.
      if (absl::Status full = mesh.memory->Grow(sizeof(Primitive) + PrimitiveBytes(*p.primitive), kWhat); !full.ok())
        return full;
      copy = RigCopy(*p.primitive);
    }
    const uint32_t node = mesh.parts[i].node;
    rig->parts.push_back(
        {copy, node, p.joints != nullptr ? scene.nodes[node].skin : -1, p.instance == nullptr ? Mat4d{} : *p.instance});
  }
  mesh.rig = std::move(rig);
  return absl::OkStatus();
}

}  // namespace voxelpipe
