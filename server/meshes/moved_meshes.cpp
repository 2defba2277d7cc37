#include "meshes/moved_meshes.h"

#include <utility>

#include "mesh/content_id.h"

namespace voxelpipe {

std::shared_ptr<TriangleMesh> MovedMeshes::Copy(const std::shared_ptr<const TriangleMesh>& like, bool keep_one) {
  std::unique_ptr<TriangleMesh> copy;
  {
    const std::lock_guard lock(mutex_);
    // The copy is of another mesh if textures were decoded since.
    if (spare_ && spare_of_.lock() == like) copy = std::move(spare_);
  }
  if (!copy) {
    copy = std::make_unique<TriangleMesh>(*like);
    copy->rig.reset();  // it would restore the original vertices
  }
  copy->content_id = NewMovedId(like->content_id);
  if (!keep_one) return copy;
  return {copy.release(), [pool = weak_from_this(), of = std::weak_ptr(like)](TriangleMesh* done) {
            std::unique_ptr<TriangleMesh> back(done);
            if (const auto meshes = pool.lock()) meshes->GiveBack(std::move(back), of);
          }};
}

void MovedMeshes::GiveBack(std::unique_ptr<TriangleMesh> copy, const std::weak_ptr<const TriangleMesh>& of) {
  const std::lock_guard lock(mutex_);
  copy.swap(spare_);  // the most recently used copy is in the caches
  spare_of_ = of;
}

}  // namespace voxelpipe
