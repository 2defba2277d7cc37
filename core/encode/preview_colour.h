// The colour of a voxel in the preview.
#pragma once

#include <cstdint>

#include "base/vec.h"
#include "encode/preview_volume.h"
#include "pipeline/voxelize.h"

namespace voxelpipe {

// The rule is at RenderPreview. Borrows the result, which must outlive it.
class PreviewColours {
 public:
  PreviewColours(const VoxelizeResult& result, const PreviewVolume& volume);

  // Linear RGB in [0, 1] of voxel n of the linear order.
  Vec3f At(uint64_t n) const;

 private:
  enum class Kind { kPlain, kLinearRgb, kUnitVector, kScalar };

  float Value(uint64_t n, int component) const {
    return values_[n * voxel_stride_ + uint64_t(component) * component_stride_];
  }
  void FindRange(const PreviewVolume& volume);

  Kind kind_ = Kind::kPlain;
  const float* values_ = nullptr;
  uint64_t voxel_stride_ = 1, component_stride_ = 1;
  float low_ = 0, high_ = 0;  // range of a scalar over the solid voxels
};

}  // namespace voxelpipe
