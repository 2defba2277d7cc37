// The report of a run of `voxelpipe batch`.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "batch/batch_run.h"
#include "batch/manifest.h"
#include "encode/atomic_file.h"

namespace voxelpipe::cli {

// {"items", "done", "skipped", "failed", "left", "warned", "bytes", "seconds"}.
nlohmann::ordered_json TotalsJson(const BatchResult& result);
// A summary of one line.
std::string TotalsLine(const BatchResult& result);

// Writes the report while the run goes on: one JSON object, with a line for each item that has ended, in the order of
// the list, but for items that take longer than the kMaxHeld after them. Items that were not done are counted, not
// listed. The file appears under its name when it is complete. Used by one thread at a time.
class ReportWriter {
 public:
  static constexpr size_t kMaxHeld = 65536;

  // Creates directories, and removes temporary files that a killed run left of this report. The system's error with the
  // path.
  static absl::StatusOr<ReportWriter> Create(const std::string& path, const BatchPlan& plan);

  void Add(const BatchItem& item, const ItemReport& report);
  // Writes the rest; with what is known of the manifest, which was perhaps not read to its end. The first error of all
  // writing.
  absl::Status Finish(const BatchResult& result, const ManifestFacts& manifest);

 private:
  ReportWriter(AtomicFile file, const Shard& shard);
  void Write(const std::string& text);

  AtomicFile file_;
  Shard shard_;
  std::map<size_t, std::string> held_;  // by the item's number
  size_t next_;                         // the number that is to be written next
  bool any_ = false;                    // item is written
  absl::Status status_ = absl::OkStatus();
};

}  // namespace voxelpipe::cli
