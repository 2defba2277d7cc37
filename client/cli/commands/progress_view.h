// The progress of a command on stderr: a line on a terminal, or JSON lines.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "command_line/command.h"
#include "engine/progress_text.h"

namespace voxelpipe::cli {

// Adds --progress auto|json|none to `command`.
void AddProgressFlag(Command& command, std::string& kind, const std::string& group);

// With "auto" a line on stderr if that is a terminal, which the destructor removes; with "json" a line for each change,
// at most ten a second within a stage. Never on stdout. Used by one thread at a time.
class ProgressView {
 public:
  ProgressView(const std::string& kind, size_t items);
  ~ProgressView();
  ProgressView(const ProgressView&) = delete;
  ProgressView& operator=(const ProgressView&) = delete;

  // The number of items, where it was not known before: 0 until then.
  void set_items(size_t items) { state_.items = items; }
  // The next item of a list begins.
  void Begin(size_t item);
  // `fraction` in [0, 1] of the stage of the item that runs.
  void Show(std::string_view stage, double fraction);
  // The size of its grid, from now on shown as a rate.
  void set_voxels(uint64_t voxels) { voxels_ = voxels; }
  // How many items have ended, of several that may run at once, and how many of them failed.
  void ShowEnded(size_t ended, size_t failed);
  // An item of the list has ended.
  void End(bool failed);
  // All is done: the last JSON line.
  void Finish();
  // Removes the line, for example before other output.
  void Clear();

 private:
  using Clock = std::chrono::steady_clock;
  enum class Kind { kNone, kLine, kJson };

  void Draw(bool at_once);

  Kind kind_;
  ProgressState state_;
  uint64_t voxels_ = 0;  // 0: not known
  bool drawn_ = false;
  const Clock::time_point begin_ = Clock::now();
  Clock::time_point item_begin_ = begin_, last_ = begin_;
};

}  // namespace voxelpipe::cli
