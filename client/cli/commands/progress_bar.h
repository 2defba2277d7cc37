// One line on a terminal that shows the current stage.
#pragma once

#include <chrono>
#include <string_view>

namespace voxelpipe::cli {

// Draws on stderr if that is a terminal, otherwise does nothing. The destructor removes the line.
class ProgressBar {
 public:
  ProgressBar();
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  // `fraction` in [0, 1] of the stage.
  void Show(std::string_view stage, double fraction);
  // Removes the line, for example before other output.
  void Clear();

 private:
  using Clock = std::chrono::steady_clock;
  bool terminal_;
  bool drawn_ = false;
  Clock::time_point last_;
};

}  // namespace voxelpipe::cli
