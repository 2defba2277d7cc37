// A directory of files that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// Created under a temporary name as that of an AtomicFile; Commit() renames it. Without Commit(), the destructor
// removes it with its files.
class AtomicDirectory {
 public:
  // `mark` is a file that tells an earlier directory of this kind, which Commit replaces. Errors: ALREADY_EXISTS if
  // something else has the name; otherwise the system's, with the path. Both are IsOutputError.
  static absl::StatusOr<AtomicDirectory> Create(const std::string& path, const std::string& mark);

  AtomicDirectory(AtomicDirectory&& other) noexcept;
  AtomicDirectory& operator=(AtomicDirectory&&) = delete;
  ~AtomicDirectory();

  // Writes a whole file; `name` may have directories, which are created. From several threads for different files. The
  // system's error with the path; `job` may be null.
  absl::Status WriteFile(const std::string& name, std::span<const uint8_t> bytes, const JobContext* job) const;

  // Renames. An earlier directory of the name is replaced at once where the system can exchange names, and removed.
  absl::Status Commit();

 private:
  AtomicDirectory() = default;
  absl::Status CheckPrevious() const;

  std::string path_;        // as given, for errors
  std::string final_path_;  // the name after Commit
  std::string temporary_;   // empty after Commit
  std::string mark_;
};

}  // namespace voxelpipe
