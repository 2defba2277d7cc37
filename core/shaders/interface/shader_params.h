// The parameter block that a shader reads, the same on both devices.
#pragma once

namespace voxelpipe {

// `value` holds the shader's parameters one after the other, in the order of its ShaderInfo::parameters.
struct ShaderParams {
  static constexpr int kCapacity = 48;
  double value[kCapacity] = {};
};

}  // namespace voxelpipe
