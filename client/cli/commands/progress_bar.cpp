#include "commands/progress_bar.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <string>

namespace voxelpipe::cli {

ProgressBar::ProgressBar() : terminal_(isatty(STDERR_FILENO) == 1), last_(Clock::now()) {}

ProgressBar::~ProgressBar() {
  Clear();
}

void ProgressBar::Show(std::string_view stage, double fraction) {
  using std::chrono::milliseconds;
  // Not for jobs that end at once, and at most as often as the eye can follow.
  if (!terminal_ || Clock::now() - last_ < milliseconds(80)) return;
  last_ = Clock::now();
  constexpr int kWidth = 30;
  const int filled = int(std::clamp(fraction, 0.0, 1.0) * kWidth);
  const std::string bar = std::string(size_t(filled), '#') + std::string(size_t(kWidth - filled), '.');
  std::fprintf(stderr, "\r[%s] %3d %%  %.*s\033[K", bar.c_str(), int(fraction * 100), int(stage.size()), stage.data());
  std::fflush(stderr);
  drawn_ = true;
}

void ProgressBar::Clear() {
  if (drawn_) std::fputs("\r\033[K", stderr);
  drawn_ = false;
}

}  // namespace voxelpipe::cli
