// A file that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// Created under a temporary name in the directory of the file that `path` names, symbolic links followed; Commit()
// renames it. Without Commit(), the destructor removes it. An existing file keeps its mode, and its owner if the system
// allows. A FIFO, a device or a file without a name of its own is written in place instead: nothing is renamed, and
// written bytes stay.
class AtomicFile {
 public:
  // The system's error, with the path, if the file cannot be created. For a FIFO it waits for a reader, or until the
  // job ended; `job` may be null.
  static absl::StatusOr<AtomicFile> Create(const std::string& path, const JobContext* job = nullptr);

  // This process's standard output, written in place: a file, a pipe or a device.
  static absl::StatusOr<AtomicFile> StandardOutput();

  // A name beside `path` that no other file of this process has.
  static std::string TemporaryName(const std::string& path);
  // The stem of the temporary names of a file, before a mark and two numbers: its path, with a long name cut. Links are
  // not followed.
  static std::string TemporaryStem(const std::string& path);
  // In: a path. Out: the stem, if this is the temporary name of such a file, which a killed process leaves behind;
  // otherwise empty.
  static std::string StemOf(const std::string& temporary);

  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Appends all of `bytes`, or the system's error with the path. `job` may be null; it is polled every few megabytes.
  // The process must ignore SIGXFSZ and SIGPIPE to get their errors here.
  absl::Status Write(std::span<const uint8_t> bytes, const JobContext* job = nullptr);

  // False if the file is written in place: then WriteAt must not be called.
  bool can_write_at() const { return !temporary_.empty(); }
  // Replaces bytes that were written before, from `offset` on; Write continues at the end. Errors as Write has them.
  absl::Status WriteAt(uint64_t offset, std::span<const uint8_t> bytes);

  // Closes and renames. After that the object is empty.
  absl::Status Commit();

 private:
  AtomicFile() = default;

  std::string path_;        // as given, for errors
  std::string final_path_;  // the name after Commit
  std::string temporary_;   // empty if the file is written in place
  int descriptor_ = -1;
};

// In: a number of errno and what could not be done. Out: its status, for which IsOutputError is true.
absl::Status OutputError(int error, const std::string& what);
absl::Status AsOutputError(absl::Status status);
// True if an error is about writing a file, not about its contents.
bool IsOutputError(const absl::Status& status);
// The number of errno of such an error; 0 where it has none.
int OutputErrno(const absl::Status& status);

}  // namespace voxelpipe
