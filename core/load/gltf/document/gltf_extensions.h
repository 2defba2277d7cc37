// What of extensionsRequired the loader reads, passes over, and refuses.
#pragma once

#include <string_view>

namespace voxelpipe::gltf {

enum class ExtensionSupport {
  kRead,     // implemented
  kIgnored,  // it cannot change static triangles, nor what shaders read: a warning
  kRefused,  // it can, or it is unknown here: an error
};

ExtensionSupport SupportOf(std::string_view extension);

}  // namespace voxelpipe::gltf
