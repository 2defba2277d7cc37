// A file that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// Created beside `path` under a temporary name; Commit() renames it. Destroyed without Commit(), it leaves nothing
// behind.
class AtomicFile {
 public:
  // The system's error, with the path, if the file cannot be created.
  static absl::StatusOr<AtomicFile> Create(const std::string& path);

  // In: a path. Out: what it was to become, if it is the temporary name of such a file, which a process that was killed leaves
  // behind; otherwise an empty text.
  static std::string FinalPath(const std::string& temporary);

  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Appends all of `bytes`, or the system's error with the path. `job` may be null; it is asked every few megabytes.
  absl::Status Write(std::span<const uint8_t> bytes, const JobContext* job = nullptr);

  // Closes and renames. After that the object is empty.
  absl::Status Commit();

 private:
  AtomicFile() = default;

  std::string path_, temporary_;
  int descriptor_ = -1;
};

}  // namespace voxelpipe
