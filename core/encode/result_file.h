// Sinks that write results to .raw, .npy and .npz files while they are made.
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
// Without Commit(), the destructor removes them. Uses memory for a piece, for sparse results also for their bricks.
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

// By the extension of `path`:
//   .raw   dense: each array's bytes as they are, one file a target (OutputPaths), and PATH.json, which describes them all
//   .npy   dense: one file a target; bits as uint8 0/1
//   .npz   any kind: target0, target1, ...; sparse: ijk int32 (n, 3) in x, y, z; buckets: ijk, offsets int64 (n + 1),
//          triangle uint32 (m); always dims int64 (3), origin and voxel_size float64 (3), index_to_world float64 (4, 4)
// `job` may be null; it is polled between pieces and must outlive the object. INVALID_ARGUMENT for another extension,
// and from Begin for a kind that the format cannot hold; otherwise the system's error with the path.
absl::StatusOr<std::unique_ptr<ResultFile>> OpenResultFile(const std::string& path, const JobContext* job);

// The same for this process's standard output, in the format of `extension` (.raw, .npy, .npz). A .raw has no
// description there. INVALID_ARGUMENT from Begin also for several targets into .raw or .npy.
absl::StatusOr<std::unique_ptr<ResultFile>> OpenStandardOutput(const std::string& extension, const JobContext* job);

// True if files of this extension can hold results of this kind.
bool CanHold(const std::string& extension, ResultKind kind);

}  // namespace voxelpipe
