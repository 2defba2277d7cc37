// Sinks that write results to files while they are made.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/result.h"

namespace voxelpipe {

// Receives a result through ResultSink, in any pieces, and writes it under temporary names; Commit() renames them.
// Without Commit(), the destructor removes them. The memory that it uses depends on the format (formats/writers.h).
class ResultFile : public ResultSink {
 public:
  // The SHA-256 of all bytes in stream order, for formats that store it. Before Commit().
  void set_sha256(std::string digits) { sha256_ = std::move(digits); }
  virtual absl::Status Commit() = 0;

 protected:
  const std::string& sha256() const { return sha256_; }

 private:
  std::string sha256_;
};

// A writer of the format of the extension of `path` (format_registry.h; each format's contents: formats/writers.h).
// `job` may be null; it is polled between pieces and must outlive the object. INVALID_ARGUMENT for an extension without
// a writer, and from Begin for a result that the format cannot hold; otherwise the system's error with the path.
absl::StatusOr<std::unique_ptr<ResultFile>> OpenResultFile(const std::string& path, const JobContext* job);

// The same for this process's standard output, in the format of `extension`. A .raw has no description there.
// INVALID_ARGUMENT for a format that cannot be written front to back, and from Begin for several targets into a format
// of one file a target.
absl::StatusOr<std::unique_ptr<ResultFile>> OpenStandardOutput(const std::string& extension, const JobContext* job);

}  // namespace voxelpipe
