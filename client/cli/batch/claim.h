// Claims of items: the run that works on an item says so, and a run that was killed leaves its claims behind.
#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "batch/item_parser.h"
#include "batch/run_presence.h"

namespace voxelpipe::cli {

// The path of an item's claim, in the directory of its record.
std::string ClaimPath(const std::string& output_dir, const BatchItem& item);

// An item that belongs to this run until the object is destroyed, which is after its record was written. It is a
// symbolic link whose text is the run's id: links are made at once or not at all, on network file systems too, and
// nothing follows this one. Where the file system has no links, every claim succeeds. Two runs may have one item where
// one of them was taken for dead; they then write the same bytes.
class Claim {
 public:
  // Empty if another run that is alive has the item. A claim of a dead run is taken over, and the temporary files that
  // it left of this item are removed. The item may have been done just before: look at its record again. Errors: the
  // system's, as IsOutputError.
  static absl::StatusOr<std::optional<Claim>> Take(const std::string& output_dir, const BatchItem& item,
                                                   const RunPresence& run);
  // True if another run that is alive has the item, so that Take would give nothing.
  static bool IsTaken(const std::string& output_dir, const BatchItem& item, const RunPresence& run);
  Claim(Claim&& other) noexcept;
  Claim& operator=(Claim&&) = delete;
  ~Claim();

  // Removes the claim of a dead run on an item that is done: the run was killed after it had written the record.
  static void RemoveDead(const std::string& output_dir, const BatchItem& item, const RunPresence& run);

 private:
  Claim(std::string path, std::string id);

  std::string path_;  // empty: there is nothing to remove
  std::string id_;
};

// Removes temporary files of this item's outputs and record, and of claims of dead runs. No other process may be
// writing them: `run` has the item.
void RemoveLeftovers(const std::string& output_dir, const BatchItem& item, const RunPresence& run);

}  // namespace voxelpipe::cli
