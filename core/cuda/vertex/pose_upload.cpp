// Uploads a pose: the primitives before any pose, which are cached with the mesh, and the matrices and weights of the
// request.
#include <unordered_map>
#include <vector>

#include "absl/strings/str_cat.h"
#include "cuda/device/mesh_uploads.h"
#include "cuda/device/pinned.h"
#include "cuda/device/upload_layout.h"
#include "cuda/vertex/vertex_shade.h"
#include "mesh/content_id.h"

namespace voxelpipe::cuda {
namespace {

// Packs distinct host arrays into one block and records their offsets.
class Block {
 public:
  template <typename T>
  void Add(const T* from, uint64_t count) {
    if (from == nullptr || count == 0 || !at_.emplace(from, layout_.bytes()).second) return;
    layout_.Add(from, count);
  }
  uint64_t bytes() const { return layout_.bytes(); }

  // Address of an array in the block that starts at `there`; null if it was not added.
  template <typename T>
  const T* At(const uint8_t* there, const T* from) const {
    const auto found = at_.find(from);
    return found == at_.end() ? nullptr : reinterpret_cast<const T*>(there + found->second);
  }

  absl::Status Upload(uint8_t* there, RunState& state) const {
    if (bytes() == 0) return absl::OkStatus();
    absl::StatusOr<PinnedBuffer> between = PinnedBuffer::Take(bytes());
    if (!between.ok()) return between.status();
    layout_.CopyTo(between->data());
    VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(there, between->data(), bytes(), cudaMemcpyHostToDevice, state.stream));
    state.staged.push_back(*std::move(between));
    return absl::OkStatus();
  }

 private:
  UploadLayout layout_;
  std::unordered_map<const void*, uint64_t> at_;
};

void AddRest(const RestPrimitiveView& rest, uint64_t vertices, Block& block) {
  block.Add(rest.positions, vertices);
  block.Add(rest.normals, vertices);
  block.Add(rest.tangents, vertices);
  for (int set = 0; set < 2; ++set) {
    block.Add(rest.joints[set], vertices);
    block.Add(rest.weights[set], vertices);
  }
  for (uint32_t i = 0; i < rest.target_count; ++i) {
    block.Add(rest.targets[i].positions, vertices);
    block.Add(rest.targets[i].normals, vertices);
    block.Add(rest.targets[i].tangents, vertices);
  }
}

// Uploads the primitives' arrays, or finds them in the cache.
absl::StatusOr<const uint8_t*> UploadRest(RunState& state, const Block& block, DeviceArray<uint8_t>& own) {
  const SharedArrays shared = SharedArraysOf(state.host.mesh.content_id);
  if (!shared.id.empty() && block.bytes() > 0) {
    auto kept = CachedMade(state.device.ordinal, absl::StrCat(shared.id, "/rest"), block.bytes(), state.stream,
                           [&](uint8_t* there) {
                             CountMeshUpload(state.device.ordinal, block.bytes());
                             return block.Upload(there, state);
                           });
    if (!kept.ok()) return kept.status();
    state.cached.push_back(*std::move(kept));
    return state.cached.back()->data();
  }
  VOXELPIPE_OK_OR_RETURN(own.Resize(block.bytes(), state.stream));
  VOXELPIPE_OK_OR_RETURN(block.Upload(own.data(), state));
  CountMeshUpload(state.device.ordinal, block.bytes());
  return own.data();
}

}  // namespace

absl::Status UploadPose(RunState& state, const PosedMesh& posed, DevicePose& memory, VertexArgs& args) {
  const std::vector<MeshPart>& parts = state.host.mesh.parts;
  Block rest;
  for (size_t i = 0; i < posed.parts.size(); ++i) AddRest(posed.parts[i].rest, parts[i].vertex_count, rest);
  const absl::StatusOr<const uint8_t*> rest_there = UploadRest(state, rest, memory.rest);
  if (!rest_there.ok()) return rest_there.status();

  std::vector<PosedPartView> views = posed.parts;
  std::vector<std::vector<MorphTargetView>> targets = posed.targets;
  std::vector<uint64_t> first;
  Block pose;
  pose.Add(views.data(), views.size());
  for (size_t i = 0; i < views.size(); ++i) {
    first.push_back(parts[i].first_vertex);
    pose.Add(targets[i].data(), targets[i].size());
    for (const PoseView* at : {&posed.parts[i].pose, &posed.parts[i].later}) {
      pose.Add(at->joints, at->joint_count);
      pose.Add(at->target_weights, posed.parts[i].rest.target_count);
    }
  }
  pose.Add(first.data(), first.size());
  VOXELPIPE_OK_OR_RETURN(memory.pose.Resize(pose.bytes(), state.stream));
  const uint8_t* const there = memory.pose.data();
  for (size_t i = 0; i < views.size(); ++i) {
    RestPrimitiveView& r = views[i].rest;
    r.positions = rest.At(*rest_there, r.positions);
    r.normals = rest.At(*rest_there, r.normals);
    r.tangents = rest.At(*rest_there, r.tangents);
    for (int set = 0; set < 2; ++set) {
      r.joints[set] = rest.At(*rest_there, r.joints[set]);
      r.weights[set] = rest.At(*rest_there, r.weights[set]);
    }
    for (MorphTargetView& target : targets[i]) {
      target.positions = rest.At(*rest_there, target.positions);
      target.normals = rest.At(*rest_there, target.normals);
      target.tangents = rest.At(*rest_there, target.tangents);
    }
    r.targets = pose.At(there, static_cast<const MorphTargetView*>(targets[i].data()));
    for (PoseView* at : {&views[i].pose, &views[i].later}) {
      at->joints = pose.At(there, at->joints);
      at->target_weights = pose.At(there, at->target_weights);
    }
  }
  VOXELPIPE_OK_OR_RETURN(pose.Upload(memory.pose.data(), state));
  args.posed = pose.At(there, static_cast<const PosedPartView*>(views.data()));
  args.first_vertex = pose.At(there, static_cast<const uint64_t*>(first.data()));
  args.part_count = uint32_t(views.size());
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
