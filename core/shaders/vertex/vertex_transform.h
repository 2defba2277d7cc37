// transform: the vertex multiplied by a matrix.
#pragma once

#include "shaders/interface/vertex.h"

namespace voxelpipe {

// position' = M position. Parameters: `matrix` and `matrix_previous`, 16 numbers each, row major, applied to column
// vectors, last row (0, 0, 0, 1); `dt`, seconds. Normals are multiplied by the inverse transpose, tangents by M. A
// mirroring matrix flips the winding, and with it geometric_normal, and the handedness of tangents. With dt > 0,
// velocity = (M p - M_previous p) / dt.
struct TransformVertexShader {
  static constexpr int kParameters = 33;
  VOXELPIPE_HD static ShadedVertex Shade(const VertexInput& in, const ShaderParams& params) {
    Mat4d m, previous;
    for (int i = 0; i < 16; ++i) {
      m.m[i / 4][i % 4] = params.value[i];
      previous.m[i / 4][i % 4] = params.value[16 + i];
    }
    const Vec3f& n = in.flat.normal;
    const Vec4f& t = in.flat.tangent;
    ShadedVertex out;
    out.position = TransformPoint(m, in.flat.position);
    out.normal = Normalized(TransformNormal(m, Vec3d{n.x, n.y, n.z}));
    const Vec3f tangent = Normalized(TransformVector(m, Vec3d{t.x, t.y, t.z}));
    out.tangent = {tangent.x, tangent.y, tangent.z, Determinant3(m) < 0 ? -t.w : t.w};
    out.velocity = VelocityBetween(TransformPoint(previous, in.flat.position), out.position, params.value[32]);
    return out;
  }
};

}  // namespace voxelpipe
