// Copies of one kept mesh that differ from it in their positions.
#pragma once

#include <memory>
#include <mutex>

#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// A job that brings new positions writes them into a copy. The copy of a job that has ended serves the next one, so
// that of a mesh which moves from frame to frame nothing but its positions is written. Thread-safe.
class MovedMeshes : public std::enable_shared_from_this<MovedMeshes> {
 public:
  // All of `like` but its rig, and positions that the caller sets before it shares the copy; content_id is a new one.
  // `keep_one`: whether a copy is kept when its last owner lets go of it, which may be after this object is gone. May
  // throw bad_alloc.
  std::shared_ptr<TriangleMesh> Copy(const std::shared_ptr<const TriangleMesh>& like, bool keep_one);

 private:
  void GiveBack(std::unique_ptr<TriangleMesh> copy, const std::weak_ptr<const TriangleMesh>& of);

  std::mutex mutex_;
  std::unique_ptr<TriangleMesh> spare_;
  std::weak_ptr<const TriangleMesh> spare_of_;
};

}  // namespace voxelpipe
