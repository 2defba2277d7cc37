// The approximate slowdown of a build with a sanitizer.
#pragma once

namespace voxelpipe::testing {

#if defined(__SANITIZE_THREAD__)
inline constexpr int kSlowdown = 8;
#elif defined(__SANITIZE_ADDRESS__)
inline constexpr int kSlowdown = 3;
#else
inline constexpr int kSlowdown = 1;
#endif

}  // namespace voxelpipe::testing
