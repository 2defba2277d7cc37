// Wall time for the stages that the CLI itself runs.
#pragma once

#include <chrono>

namespace voxelpipe::cli {

class Stopwatch {
 public:
  double Milliseconds() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace voxelpipe::cli
