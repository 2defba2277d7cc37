// A node's transform in glTF's form: translation, rotation, scale.
#pragma once

#include <array>
#include <cmath>

#include "base/vec.h"

namespace voxelpipe {

struct Trs {
  Vec3d translation{0, 0, 0};
  std::array<double, 4> rotation{0, 0, 0, 1};  // quaternion x, y, z, w
  Vec3d scale{1, 1, 1};
};

// Translation * rotation * scale. The quaternion is normalized; a zero one counts as no rotation.
inline Mat4d FromTrs(const Trs& trs) {
  double x = trs.rotation[0], y = trs.rotation[1], z = trs.rotation[2], w = trs.rotation[3];
  const double length = std::sqrt(x * x + y * y + z * z + w * w);
  // Unit quaternions are not changed, so that 90-degree turns of dyadic coordinates stay exact.
  if (length == 0 || !std::isfinite(length)) {
    x = y = z = 0;
    w = 1;
  } else if (std::abs(length - 1) > 1e-15) {
    x /= length, y /= length, z /= length, w /= length;
  }
  Mat4d out;
  const double r[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                          {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                          {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out.m[i][j] = r[i][j] * trs.scale[j];
    out.m[i][3] = trs.translation[i];
  }
  return out;
}

}  // namespace voxelpipe
