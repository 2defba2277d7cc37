// A stored mesh: loaded once, used by many jobs at the same time.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/load_mesh.h"
#include "load/loader.h"
#include "mesh/report.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/material.h"
#include "mesh/triangle_mesh.h"
#include "meshes/moved_meshes.h"

namespace voxelpipe {

class LoadWorkers;

// Thread-safe. Returned meshes never change: textures are decoded into a copy, which replaces the mesh.
class KeptMesh {
 public:
  // `name`: that of MeshNameOf (wire/mesh_name.h). `type`: of the file, its format not kAuto. Errors: the job's. May
  // throw bad_alloc.
  static absl::StatusOr<std::shared_ptr<KeptMesh>> Make(const JobContext& job, std::string name, MeshFileType type,
                                                        uint64_t file_bytes, LoadedMesh loaded);
  // `report`: BoxReport of the mesh.
  KeptMesh(std::string name, MeshFileType type, uint64_t file_bytes, LoadedMesh loaded, const MeshReport& report);

  const std::string& name() const { return name_; }
  const MeshFileType& type() const { return type_; }
  uint64_t file_bytes() const { return file_bytes_; }
  uint64_t triangles() const { return triangles_; }  // of the flattened mesh
  uint64_t vertices() const { return vertices_; }
  // Its current memory: arrays, names, decoded images; and the same again for the copy with moved vertices, once a job
  // used one.
  uint64_t memory_bytes() const { return memory_bytes_.load() * (keeps_moved_ ? 2 : 1); }
  uint64_t uses() const { return uses_.load(); }
  void CountUse() { ++uses_; }

  // The mesh, with the textures decoded that `use` samples; at least those. The first call for a texture decodes it,
  // while other calls for textures wait. A mesh with textures has another content_id than the one without. `workers`:
  // the processes that decode them (isolate/loading.h). Memory for decoding is charged to the job until it is done.
  // Errors: those of DecodeTextures, at each attempt; the job's; RESOURCE_EXHAUSTED out of memory.
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> Mesh(const JobContext& job, const TextureUse& use,
                                                           const LoadLimits& limits, LoadWorkers* workers = nullptr);

  // A copy of `mesh`, a mesh of this object, whose positions the caller sets (MovedMeshes). Sets `keep_one`.
  std::shared_ptr<TriangleMesh> Moved(const std::shared_ptr<const TriangleMesh>& mesh, bool keep_one);
  bool keeps_moved() const { return keeps_moved_; }

  // True if Mesh would return those textures without decoding any.
  bool ready(const TextureUse& use) const;

  // Facts about the mesh, including its warnings; with degenerate triangles and open edges once Examine has counted
  // them.
  struct Facts {
    MeshReport report;
    bool examined = false;   // true if they were counted
    WarningList warnings{};  // including those of all its textures
  };
  Facts Report() const;
  // The same with degenerate triangles and open edges, which the first call counts while others wait. Errors: those of
  // ReportMesh, the job's. May throw bad_alloc.
  absl::StatusOr<Facts> Examine(const JobContext& job);

 private:
  // Locks `preparing`, a lock of preparing_, or returns the job's error, because its holder may wait for memory.
  static absl::Status Lock(std::unique_lock<std::timed_mutex>& preparing, const JobContext& job);

  const std::string name_;
  const MeshFileType type_;
  const uint64_t file_bytes_;
  const uint64_t triangles_, vertices_;
  std::atomic<uint64_t> memory_bytes_{0}, uses_{0};
  std::atomic<bool> keeps_moved_{false};
  const std::shared_ptr<MovedMeshes> moved_ = std::make_shared<MovedMeshes>();

  std::timed_mutex preparing_;  // held while textures are decoded or edges counted; taken before mutex_
  mutable std::mutex mutex_;    // held only briefly
  std::shared_ptr<const TriangleMesh> mesh_;
  TextureUse prepared_;
  Facts facts_;
};

}  // namespace voxelpipe
