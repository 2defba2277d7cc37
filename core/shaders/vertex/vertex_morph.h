// morph: glTF morph targets at given weights or at a time of an animation.
#pragma once

#include "shaders/interface/vertex.h"

namespace voxelpipe {

// Positions, normals and tangents plus the weighted displacements of the primitive's morph targets; nodes and joints
// stay in the file's own pose. The host puts the weights into the pose (pose.h). Parameter slot 0: dt, seconds
// (ShadePosed).
struct MorphVertexShader {
  static constexpr int kParameters = 1;
  VOXELPIPE_HD static ShadedVertex Shade(const VertexInput& in, const ShaderParams& params) {
    return ShadePosed(in, params.value[0]);
  }
};

}  // namespace voxelpipe
