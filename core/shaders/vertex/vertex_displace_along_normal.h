// displace_along_normal: moves the surface along its normals.
#pragma once

#include "shaders/interface/vertex.h"

namespace voxelpipe {

// position' = position + distance * normal. Parameter `distance`: world units, negative ones move inwards. Vertices
// without a normal stay where they are: flat normals would tear the surface open at its edges. It does tear at vertices
// that the file duplicates because their normals differ (hard edges).
struct DisplaceAlongNormalVertexShader {
  static constexpr int kParameters = 1;
  VOXELPIPE_HD static ShadedVertex Shade(const VertexInput& in, const ShaderParams& params) {
    const Vec3f& n = in.flat.normal;
    ShadedVertex out = in.flat;
    out.position = in.flat.position + Vec3d{n.x, n.y, n.z} * params.value[0];
    return out;
  }
};

}  // namespace voxelpipe
