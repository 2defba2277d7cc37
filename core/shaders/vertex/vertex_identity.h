// identity: the vertex as it is.
#pragma once

#include "shaders/interface/vertex.h"

namespace voxelpipe {

struct IdentityVertexShader {
  static constexpr int kParameters = 0;
  VOXELPIPE_HD static ShadedVertex Shade(const VertexInput& in, const ShaderParams&) { return in.flat; }
};

}  // namespace voxelpipe
