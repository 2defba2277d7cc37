// Inputs to shade one target for a whole triangle: its value is the same for all fragments. No host-only includes.
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
