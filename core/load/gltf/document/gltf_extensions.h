// The extensions of extensionsRequired that the loader reads, ignores and refuses.
#pragma once

#include <string_view>

namespace voxelpipe::gltf {

enum class ExtensionSupport {
  kRead,     // implemented
  kIgnored,  // it cannot change static triangles, nor what shaders read: a warning
  kRefused,  // it can change them, or is unknown: an error
};

ExtensionSupport SupportOf(std::string_view extension);

}  // namespace voxelpipe::gltf
