// The number of repetitions of a test.
#pragma once

#include <algorithm>
#include <cstdlib>

#include "support/slowdown.h"

namespace voxelpipe::testing {

// `thorough` if the environment has VOXELPIPE_THOROUGH_TESTS, otherwise `usual`.
inline int Effort(int usual, int thorough) {
  return std::getenv("VOXELPIPE_THOROUGH_TESTS") == nullptr ? usual : thorough;
}

// Scales an amount of work (rounds, triangles of LargeTrianglesGlb), so that a build with a sanitizer takes about as
// long as one without takes for `plain`.
inline int LessIfSlow(int plain) {
  return std::max(1, plain / kSlowdown);
}

}  // namespace voxelpipe::testing
