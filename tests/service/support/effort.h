// How much a test that repeats itself does.
#pragma once

#include <algorithm>
#include <cstdlib>

#include "support/slowdown.h"

namespace voxelpipe::testing {

// `thorough` where the environment has VOXELPIPE_THOROUGH_TESTS, else `usual`.
inline int Effort(int usual, int thorough) {
  return std::getenv("VOXELPIPE_THOROUGH_TESTS") == nullptr ? usual : thorough;
}

// Of something to do (rounds, triangles of LargeTrianglesGlb) as much as takes a build with a sanitizer about as long
// as `plain` takes one without.
inline int LessIfSlow(int plain) {
  return std::max(1, plain / kSlowdown);
}

}  // namespace voxelpipe::testing
