// What a run that was killed left behind.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "batch/manifest.h"

namespace voxelpipe::cli {

// Removes temporary files of these items' outputs and records. No other process may be writing them.
void RemoveLeftovers(const std::string& output_dir, const std::vector<BatchItem>& items);

// Held by the one run that works on a shard in an output directory; given back also when the process is killed.
class RunLock {
 public:
  // ABORTED where another run holds it. On file systems without locks it is always got.
  static absl::StatusOr<RunLock> Take(const std::string& output_dir, const Shard& shard);
  RunLock(RunLock&& other) noexcept;
  RunLock& operator=(RunLock&&) = delete;
  ~RunLock();

 private:
  RunLock(std::string path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}

  std::string path_;
  int descriptor_;
};

}  // namespace voxelpipe::cli
