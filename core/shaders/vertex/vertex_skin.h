// skin: the file's whole animated pose.
#pragma once

#include "shaders/interface/vertex.h"

namespace voxelpipe {

// Morph targets, then joints or, for meshes without a skin, the node's transform, all at one time of one animation. The
// host evaluates the animation into matrices and weights (mesh/scene/pose.h). Parameter slot 0: dt, seconds
// (ShadePosed).
struct SkinVertexShader {
  static constexpr int kParameters = 1;
  VOXELPIPE_HD static ShadedVertex Shade(const VertexInput& in, const ShaderParams& params) {
    return ShadePosed(in, params.value[0]);
  }
};

}  // namespace voxelpipe
