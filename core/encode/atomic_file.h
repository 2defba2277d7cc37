// A file that appears under its name only when it is complete.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// Created beside the file that `path` names, symbolic links followed, under a temporary name; Commit() renames it.
// Destroyed without Commit(), it leaves nothing behind. A file that was there keeps its mode, and its owner where the
// system lets it. A FIFO, a device or a file without a name of its own is written through instead: nothing is renamed,
// and bytes that were written stay written.
class AtomicFile {
 public:
  // The system's error, with the path, if the file cannot be created. For a FIFO it waits for a reader, or until the
  // job is over; `job` may be null.
  static absl::StatusOr<AtomicFile> Create(const std::string& path, const JobContext* job = nullptr);

  // What the temporary names of a file begin with, before a mark and two numbers: its path, the name cut where it is
  // long. Links are not followed.
  static std::string TemporaryStem(const std::string& path);
  // In: a path. Out: the stem, if this is the temporary name of such a file, which a process that was killed leaves
  // behind; otherwise an empty text.
  static std::string StemOf(const std::string& temporary);

  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Appends all of `bytes`, or the system's error with the path. `job` may be null; it is asked every few megabytes.
  // The process must ignore SIGXFSZ and SIGPIPE to get their errors here.
  absl::Status Write(std::span<const uint8_t> bytes, const JobContext* job = nullptr);

  // Closes and renames. After that the object is empty.
  absl::Status Commit();

 private:
  AtomicFile() = default;

  std::string path_;        // as given, for errors
  std::string final_path_;  // what the temporary file becomes
  std::string temporary_;   // empty where the file is written through
  int descriptor_ = -1;
};

// True if an error came of writing a file rather than of what was to be written.
bool IsOutputError(const absl::Status& status);

}  // namespace voxelpipe
