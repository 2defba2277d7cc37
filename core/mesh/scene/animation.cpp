#include "mesh/scene/animation.h"

#include <algorithm>
#include <cmath>

namespace voxelpipe {
namespace {

void Normalize(double* q) {
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int i = 0; i < 4 && length > 0; ++i) q[i] /= length;
}

// Spherical linear interpolation along the shorter arc (appendix C.4); linear where the arc is too short for its sine.
void Slerp(const float* from, const float* to, double u, double* out) {
  double a[4], b[4];
  std::copy(from, from + 4, a);
  std::copy(to, to + 4, b);
  Normalize(a);
  Normalize(b);
  double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  const double sign = cosine < 0 ? -1 : 1;
  cosine = std::min(1.0, cosine * sign);
  const double angle = std::acos(cosine), sine = std::sin(angle);
  const double wa = sine > 1e-9 ? std::sin((1 - u) * angle) / sine : 1 - u;
  const double wb = sign * (sine > 1e-9 ? std::sin(u * angle) / sine : u);
  for (int i = 0; i < 4; ++i) out[i] = wa * a[i] + wb * b[i];
  Normalize(out);
}

}  // namespace

void SampleAnimation(const AnimationSampler& sampler, bool rotation, double time, double* out) {
  const std::vector<float>& times = sampler.times;
  const size_t width = sampler.width;
  const bool cubic = sampler.interpolation == Interpolation::kCubicSpline;
  const size_t stride = cubic ? 3 * width : width;
  const auto value = [&](size_t key) { return sampler.values.data() + key * stride + (cubic ? width : 0); };
  const size_t after =
      size_t(std::upper_bound(times.begin(), times.end(), time, [](double t, float key) { return t < double(key); }) -
             times.begin());
  if (after == 0 || after == times.size() || sampler.interpolation == Interpolation::kStep) {
    const float* v = value(after == 0 ? 0 : after - 1);
    std::copy(v, v + width, out);
    return;
  }
  const size_t k = after - 1;
  const double td = double(times[k + 1]) - double(times[k]), u = (time - double(times[k])) / td;
  const float *v0 = value(k), *v1 = value(k + 1);
  if (!cubic) {
    if (rotation) return Slerp(v0, v1, u, out);
    for (size_t i = 0; i < width; ++i) out[i] = (1 - u) * v0[i] + u * v1[i];
    return;
  }
  const double u2 = u * u, u3 = u2 * u;
  const float *b0 = v0 + width, *a1 = v1 - width;  // out-tangent of this key, in-tangent of the next
  for (size_t i = 0; i < width; ++i) {
    out[i] = (2 * u3 - 3 * u2 + 1) * v0[i] + td * (u3 - 2 * u2 + u) * b0[i] + (3 * u2 - 2 * u3) * v1[i] +
             td * (u3 - u2) * a1[i];
  }
  if (rotation) Normalize(out);
}

}  // namespace voxelpipe
