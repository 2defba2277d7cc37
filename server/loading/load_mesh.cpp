#include "loading/load_mesh.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "load/decode/image.h"
#include "load/load_job.h"
#include "loading/mesh_bytes.h"
#include "mesh/flatten_job.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using Clock = std::chrono::steady_clock;

double MsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

// Errors of the whole file name no part of it; their field of the request is the mesh.
absl::Status OfMesh(const absl::Status& status) {
  if (!absl::IsInvalidArgument(status) || status.message().find(": ") != absl::string_view::npos) return status;
  return WithField(status, "mesh");
}

}  // namespace

absl::StatusOr<LoadedMesh> LoadMeshFor(std::span<const uint8_t> file, const LoadRequest& request,
                                        const JobContext& job, const std::function<void()>& file_used) {
  LoadedMesh loaded;
  if (absl::Status s = job.Check(); !s.ok()) return s;
  job.Report("load", 0);
  Clock::time_point begin = Clock::now();
  absl::StatusOr<Scene> scene = LoadSceneFor(job, file, request.format, request.limits);
  if (!scene.ok()) return OfMesh(scene.status());
  const uint64_t file_bytes = file.size();
  loaded.peak_bytes = file_bytes + SceneBytes(*scene);
  if (file_used) file_used();
  loaded.load_ms = MsSince(begin);
  job.Report("load", 1);

  if (absl::Status s = job.Check(); !s.ok()) return s;
  job.Report("flatten", 0);
  begin = Clock::now();
  absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, request.limits);
  if (!mesh.ok()) return OfMesh(mesh.status());
  loaded.peak_bytes = std::max(loaded.peak_bytes, SceneBytes(*scene) + MeshBytes(*mesh));
  loaded.contents = ContentsOf(*scene, *mesh, file_bytes);
  loaded.mesh = *std::move(mesh);
  loaded.flatten_ms = MsSince(begin);
  job.Report("flatten", 1);
  if (absl::Status s = job.Check(); !s.ok()) return s;
  scene = Scene();
  if (request.textures.any()) {
    if (absl::Status s = PrepareTexturesFor(job, loaded.mesh, request.limits, request.textures); !s.ok()) return s;
  }
  return loaded;
}

MeshReport BoxReport(const TriangleMesh& mesh) {
  MeshReport report;
  report.triangles = mesh.triangles.size();
  report.vertices = mesh.positions.size();
  bool first = true;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t vertex : triangle) {
      const Vec3d& p = mesh.positions[vertex];
      for (int a = 0; a < 3; ++a) {
        report.min[a] = first ? p[a] : Min(report.min[a], p[a]);
        report.max[a] = first ? p[a] : Max(report.max[a], p[a]);
      }
      first = false;
    }
  }
  return report;
}

}  // namespace voxelpipe
