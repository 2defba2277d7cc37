#include "mesh/scene_names.h"

#include <memory>
#include <new>
#include <string>
#include <utility>

#include "mesh/placement.h"

namespace voxelpipe {

absl::Status SetNames(const JobContext& job, const Scene& scene, const std::vector<uint32_t>& order,
                      TriangleMesh& mesh) {
  uint64_t bytes =
      scene.nodes.size() * (sizeof(std::string) + sizeof(uint32_t)) + scene.meshes.size() * sizeof(std::string);
  for (const Node& node : scene.nodes) bytes += node.name.size();
  for (const Mesh& named : scene.meshes) bytes += named.name.size();
  if (absl::Status full = mesh.memory->Grow(bytes, "the names of nodes and meshes"); !full.ok()) return full;
  try {
    auto names = std::make_shared<SceneNames>();
    names->nodes.reserve(scene.nodes.size());
    names->meshes.reserve(scene.meshes.size());
    for (size_t n = 0; n < scene.nodes.size(); ++n) {
      if (n % kPlacementsAStep == 0) {
        if (absl::Status over = job.Check(); !over.ok()) return over;
      }
      names->nodes.push_back(scene.nodes[n].name);
      names->named_by.push_back(uint32_t(n));
    }
    for (const uint32_t n : order) {
      for (const uint32_t child : scene.nodes[n].children) {
        if (names->nodes[child].empty()) names->named_by[child] = names->named_by[n];
      }
    }
    for (const Mesh& named : scene.meshes) names->meshes.push_back(named.name);
    mesh.names = std::move(names);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while flattening the scene");
  }
  mesh.mesh_count = uint32_t(scene.meshes.size());
  mesh.node_count = uint32_t(scene.nodes.size());
  return absl::OkStatus();
}

}  // namespace voxelpipe
