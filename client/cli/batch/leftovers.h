// Removes the leftovers of a killed run.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "batch/manifest.h"

namespace voxelpipe::cli {

// Removes temporary files of these items' outputs and records. No other process may be writing them.
void RemoveLeftovers(const std::string& output_dir, const std::vector<BatchItem>& items);

// A lock of a shard in an output directory, for one run at a time; released even if the process is killed.
class RunLock {
 public:
  // ABORTED if another run holds it; PERMISSION_DENIED or FAILED_PRECONDITION with the path if a link or something else
  // is in the place of the lock's file. Always succeeds on file systems without locks.
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
