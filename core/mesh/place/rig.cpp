#include <algorithm>
#include <memory>
#include <utility>

#include "mesh/place/join.h"
#include "mesh/scene/scene_bytes.h"

namespace voxelpipe {
namespace {

uint64_t BytesOf(const Rig& rig) {
  uint64_t bytes = (rig.nodes.size() + 1) * (sizeof(RigNode) + sizeof(uint32_t)) + rig.parts.size() * sizeof(RigPart);
  for (const RigNode& node : rig.nodes) bytes += node.weights.size() * sizeof(double);
  for (const Skin& skin : rig.skins) bytes += sizeof skin + skin.joints.size() * (sizeof(uint32_t) + sizeof(Mat4d));
  for (const Animation& animation : rig.animations) bytes += AnimationBytes(animation);
  return bytes;
}

// Appends a rig whose root nodes follow a new one with `matrix`, unless that is the identity.
void Append(const Rig& from, const Mat4d& matrix, Rig& to) {
  int64_t root = -1;
  if (!(matrix == Mat4d())) {
    root = int64_t(to.nodes.size());
    to.nodes.emplace_back().local = matrix;
    to.order.push_back(uint32_t(root));
  }
  const auto node = uint32_t(to.nodes.size());
  const auto skin = int32_t(to.skins.size());
  for (RigNode copy : from.nodes) {
    copy.parent = copy.parent < 0 ? root : copy.parent + node;
    to.nodes.push_back(std::move(copy));
  }
  for (const uint32_t n : from.order) to.order.push_back(n + node);
  for (Skin copy : from.skins) {
    for (uint32_t& joint : copy.joints) joint += node;
    to.skins.push_back(std::move(copy));
  }
  for (Animation copy : from.animations) {
    for (AnimationChannel& channel : copy.channels) channel.node += node;
    to.animations.push_back(std::move(copy));
  }
  for (RigPart copy : from.parts) {
    copy.node += node;
    if (copy.skin >= 0) copy.skin += skin;
    to.parts.push_back(std::move(copy));
  }
}

}  // namespace

absl::Status JoinRigs(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh) {
  if (std::any_of(meshes.begin(), meshes.end(), [](const PlacedMesh& placed) { return placed.mesh->rig == nullptr; })) {
    return absl::OkStatus();
  }
  auto rig = std::make_shared<Rig>();
  for (const PlacedMesh& placed : meshes) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const Rig& from = *placed.mesh->rig;
    if (absl::Status full = mesh.memory->Grow(BytesOf(from), "the rigs of the placed meshes"); !full.ok()) return full;
    Append(from, MatrixOf(placed), *rig);
  }
  mesh.rig = std::move(rig);
  return absl::OkStatus();
}

}  // namespace voxelpipe
