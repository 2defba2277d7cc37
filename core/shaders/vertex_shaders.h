// What a vertex shader receives and gives, and the built-in ones.
#pragma once

#include "base/vec.h"
#include "shaders/fragment.h"
#include "shaders/shader_params.h"

namespace voxelpipe {

// World space. `normal` is 0 where the mesh has none.
struct ShadedVertex {
  Vec3d position;
  Vec3f normal;
};

// identity: the vertex as it is.
struct IdentityVertexShader {
  VOXELPIPE_HD static ShadedVertex Shade(const ShadedVertex& in, const ShaderParams&) { return in; }
};

// transform: position' = M position. Parameter matrix: 16 numbers, row major, applied to column vectors; its last row is
// (0, 0, 0, 1). Normals go with the inverse transpose. A mirroring matrix turns the winding, and with it geometric_normal.
struct TransformVertexShader {
  VOXELPIPE_HD static ShadedVertex Shade(const ShadedVertex& in, const ShaderParams& params) {
    Mat4d m;
    for (int i = 0; i < 16; ++i) m.m[i / 4][i % 4] = params.value[i];
    const Vec3d n{in.normal.x, in.normal.y, in.normal.z};
    return {TransformPoint(m, in.position), Normalized(TransformNormal(m, n))};
  }
};

}  // namespace voxelpipe
