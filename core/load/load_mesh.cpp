#include "load/load_mesh.h"

#include <algorithm>
#include <utility>

#include "base/wall_clock.h"
#include "load/decode/image.h"
#include "load/load_job.h"
#include "mesh/flatten_job.h"
#include "mesh/mesh_bytes.h"

namespace voxelpipe {

absl::StatusOr<LoadedMesh> LoadMeshFor(const JobContext& job, std::span<const uint8_t> file, const LoadRequest& request,
                                       const std::function<void()>& file_used) {
  LoadedMesh loaded;
  if (absl::Status s = job.Check(); !s.ok()) return s;
  job.Report("load", 0);
  double begin = WallMs();
  absl::StatusOr<Scene> scene = LoadSceneFor(job, file, request.type, request.limits);
  if (!scene.ok()) return scene.status();
  const uint64_t file_bytes = file.size();
  loaded.peak_bytes = file_bytes + SceneBytes(*scene);
  if (file_used) file_used();
  loaded.load_ms = WallMs() - begin;
  job.Report("load", 1);

  if (absl::Status s = job.Check(); !s.ok()) return s;
  job.Report("flatten", 0);
  begin = WallMs();
  absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, request.limits);
  if (!mesh.ok()) return mesh.status();
  loaded.peak_bytes = std::max(loaded.peak_bytes, SceneBytes(*scene) + MeshBytes(*mesh));
  loaded.contents = ContentsOf(*scene, *mesh, file_bytes);
  loaded.mesh = *std::move(mesh);
  loaded.flatten_ms = WallMs() - begin;
  job.Report("flatten", 1);

  if (absl::Status s = job.Check(); !s.ok()) return s;
  begin = WallMs();
  scene = Scene();
  if (request.textures.any()) {
    if (absl::Status s = PrepareTexturesFor(job, loaded.mesh, request.limits, request.textures); !s.ok()) return s;
  }
  loaded.load_ms += WallMs() - begin;
  return loaded;
}

}  // namespace voxelpipe
