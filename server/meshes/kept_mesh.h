// One mesh that the server keeps: loaded once, used by many jobs at the same time.
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

// Thread-safe. No mesh that was handed out ever changes: textures are decoded into a copy, which takes the mesh's
// place.
class KeptMesh {
 public:
  // `id`: SHA-256 of the file's bytes, 64 lower-case hexadecimal digits. `format`: of the file, not kAuto.
  KeptMesh(std::string id, MeshFormat format, uint64_t file_bytes, LoadedMesh loaded);

  const std::string& id() const { return id_; }
  MeshFormat format() const { return format_; }
  uint64_t file_bytes() const { return file_bytes_; }
  uint64_t triangles() const { return triangles_; }  // of the flattened mesh
  uint64_t vertices() const { return vertices_; }
  // What it takes now: arrays, names, images as far as they are decoded; and as much for the copy of which jobs move
  // the vertices, once one did.
  uint64_t memory_bytes() const { return memory_bytes_.load() * (keeps_moved_ ? 2 : 1); }
  uint64_t uses() const { return uses_.load(); }
  void CountUse() { ++uses_; }

  // The mesh, with the textures decoded that `use` samples; at least those. The first call for a texture decodes it,
  // others for textures wait meanwhile. A mesh with textures has another content_id than the one without. `workers`:
  // that decode them (isolate/loading.h). What decoding takes is the job's until it is done.
  // Errors: those of DecodeTextures, each time anew; the job's; RESOURCE_EXHAUSTED out of memory.
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> Mesh(const JobContext& job, const TextureUse& use,
                                                           const LoadLimits& limits, LoadWorkers* workers = nullptr);

  // A copy of `mesh`, which came from here, whose positions are the caller's to set (MovedMeshes). `keep_one`: from now
  // on.
  std::shared_ptr<TriangleMesh> Moved(const std::shared_ptr<const TriangleMesh>& mesh, bool keep_one);
  bool keeps_moved() const { return keeps_moved_; }

  // True if Mesh gives those textures without decoding any.
  bool ready(const TextureUse& use) const;

  // Facts about the mesh, its warnings among them. Degenerate triangles and open edges are only among them once a call
  // of Examine has counted them.
  struct Facts {
    MeshReport report;
    bool examined = false;   // true if they were counted
    WarningList warnings{};  // all of its textures included
  };
  Facts Report() const;
  // The same with degenerate triangles and open edges, which the first call counts; others wait meanwhile. Errors:
  // those of ReportMeshFor, the job's. May throw bad_alloc.
  absl::StatusOr<Facts> Examine(const JobContext& job);

 private:
  // Locks `preparing`, which is of preparing_, or gives the job's error: who holds it may wait for memory.
  static absl::Status Lock(std::unique_lock<std::timed_mutex>& preparing, const JobContext& job);

  const std::string id_;
  const MeshFormat format_;
  const uint64_t file_bytes_;
  const uint64_t triangles_, vertices_;
  std::atomic<uint64_t> memory_bytes_{0}, uses_{0};
  std::atomic<bool> keeps_moved_{false};
  const std::shared_ptr<MovedMeshes> moved_ = std::make_shared<MovedMeshes>();

  std::timed_mutex preparing_;  // held while textures are decoded or edges counted; taken before mutex_
  mutable std::mutex mutex_;    // held for moments only
  std::shared_ptr<const TriangleMesh> mesh_;
  TextureUse prepared_;
  Facts facts_;
};

}  // namespace voxelpipe
