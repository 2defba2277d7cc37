// The part of the mesh to which the triangles of a sequence belong, looked up only where it changes.
#pragma once

#include <cstdint>

#include "mesh/views/mesh_view.h"

namespace voxelpipe::cpu {

class PartCursor {
 public:
  explicit PartCursor(const MeshView& mesh) : mesh_(mesh) {}

  bool IsIn(uint32_t triangle) const { return triangle >= begin_ && triangle < end_; }
  void MoveTo(uint32_t triangle) {
    const uint32_t number = PartOf(mesh_, triangle);
    part_ = &mesh_.parts[number];
    begin_ = part_->first_triangle;
    end_ = number + 1 < mesh_.part_count ? mesh_.parts[number + 1].first_triangle : mesh_.triangle_count;
  }
  // After MoveTo.
  const PartView& part() const { return *part_; }

 private:
  const MeshView& mesh_;
  const PartView* part_ = nullptr;
  uint64_t begin_ = 0, end_ = 0;  // of its triangles
};

}  // namespace voxelpipe::cpu
