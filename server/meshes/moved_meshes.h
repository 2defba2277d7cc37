// Copies of one stored mesh that differ from it in their positions.
#pragma once

#include <memory>
#include <mutex>

#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// A job with new positions writes them to a copy. The next job reuses the copy of a job that has ended, so that only
// the positions of a mesh that moves from frame to frame are written. Thread-safe.
class MovedMeshes : public std::enable_shared_from_this<MovedMeshes> {
 public:
  // A copy of `like` without its rig; the caller sets the positions before sharing it; content_id is new. `keep_one`:
  // true if a copy is kept after its last owner releases it, which may be after the end of this object. May throw
  // bad_alloc.
  std::shared_ptr<TriangleMesh> Copy(const std::shared_ptr<const TriangleMesh>& like, bool keep_one);

 private:
  void GiveBack(std::unique_ptr<TriangleMesh> copy, const std::weak_ptr<const TriangleMesh>& of);

  std::mutex mutex_;
  std::unique_ptr<TriangleMesh> spare_;
  std::weak_ptr<const TriangleMesh> spare_of_;
};

}  // namespace voxelpipe
