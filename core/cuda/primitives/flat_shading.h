// What shading one target's value of a triangle takes. No host-only includes.
#pragma once

#include "cuda/primitives/blend_rules.h"
#include "cuda/primitives/views.h"

namespace voxelpipe::cuda {

struct FlatShading {
  const MeshView* mesh = nullptr;
  CudaTarget target;
  ShaderTraits traits;
  Kept kept = Kept::kNothing;
  bool is_float = false;

  VOXELPIPE_HD bool has_owner() const { return kept == Kept::kBitOfOwner || kept == Kept::kOwner; }
};

}  // namespace voxelpipe::cuda
