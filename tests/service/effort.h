// How much a test that repeats itself does.
#pragma once

#include <cstdlib>

namespace voxelpipe::testing {

// `thorough` where the environment has VOXELPIPE_THOROUGH_TESTS, else `usual`.
inline int Effort(int usual, int thorough) {
  return std::getenv("VOXELPIPE_THOROUGH_TESTS") == nullptr ? usual : thorough;
}

}  // namespace voxelpipe::testing
