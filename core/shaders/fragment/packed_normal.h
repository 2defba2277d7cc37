// packed_normal: the shading normal in 16 bits.
//
// Source: Q. Meyer et al., "On Floating-Point Normal Vectors", 2010 (the octahedral map).
#pragma once

#include <cmath>

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Octahedral map, 8 + 8 bits: (u << 8) | v with u, v = round((t/2 + .5) * 255).
VOXELPIPE_HD uint32_t PackNormal(const Vec3f& n) {
  const double length = (Abs(double(n.x)) + Abs(double(n.y))) + Abs(double(n.z));
  double x = 0, y = 0;
  if (length > 0) {
    x = double(n.x) / length;
    y = double(n.y) / length;
    if (n.z < 0) {  // fold the lower half outwards
      const double fx = (1 - Abs(y)) * (x < 0 ? -1 : 1), fy = (1 - Abs(x)) * (y < 0 ? -1 : 1);
      x = fx;
      y = fy;
    }
  }
  const uint32_t u = uint32_t(floor((x / 2 + 0.5) * 255 + 0.5)), v = uint32_t(floor((y / 2 + 0.5) * 255 + 0.5));
  return (u << 8) | v;
}

// The inverse of PackNormal: the unit normal of `packed` (below 2^16), within 1.2 degrees.
VOXELPIPE_HD Vec3f UnpackNormal(uint32_t packed) {
  double x = double(packed >> 8 & 255) / 255 * 2 - 1, y = double(packed & 255) / 255 * 2 - 1;
  const double z = (1 - Abs(x)) - Abs(y);
  if (z < 0) {
    const double fx = (1 - Abs(y)) * (x < 0 ? -1 : 1), fy = (1 - Abs(x)) * (y < 0 ? -1 : 1);
    x = fx;
    y = fy;
  }
  const double length = sqrt((x * x + y * y) + z * z);
  return {float(x / length), float(y / length), float(z / length)};
}

// Output: u32, 1 component, below 2^16: the normal of the shader `normal`, packed.
struct PackedNormalShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput& in) { return !in.part->has_normals; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.u[0] = PackNormal(ShadingNormal(in));
  }
};

}  // namespace voxelpipe
