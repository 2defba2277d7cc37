// Key-framed animations of nodes. Source: glTF 2.0 specification, section 3.11 and appendix C (interpolation).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace voxelpipe {

enum class Interpolation : uint8_t { kStep, kLinear, kCubicSpline };
enum class AnimationPath : uint8_t { kTranslation, kRotation, kScale, kWeights };

struct AnimationSampler {
  Interpolation interpolation = Interpolation::kLinear;
  std::vector<float> times;   // seconds, finite, strictly ascending, at least one
  std::vector<float> values;  // `width` numbers a key; kCubicSpline: in-tangent, value, out-tangent, `width` each
  uint32_t width = 0;         // 3, 4 (a quaternion x, y, z, w), or the number of morph weights
};

struct AnimationChannel {
  uint32_t node = 0;
  AnimationPath path = AnimationPath::kTranslation;
  uint32_t sampler = 0;
};

struct Animation {
  std::string name;
  // Why the animation cannot be played, naming sampler, channel and accessor. The file loads; only requests for this
  // animation fail.
  absl::Status fault;
  std::vector<AnimationSampler> samplers;
  std::vector<AnimationChannel> channels;
};

// Writes the sampler's `width` values at `time` (seconds; before the first key the first, after the last the last) to
// `out`. Rotations are interpolated by slerp along the shorter arc, and their cubic splines normalized. Double, with
// libm: host only.
void SampleAnimation(const AnimationSampler& sampler, bool rotation, double time, double* out);

}  // namespace voxelpipe
