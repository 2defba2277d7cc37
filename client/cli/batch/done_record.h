// How a batch knows what it has finished: a small file for each item, written after the item's own files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/warning.h"
#include "batch/manifest.h"

namespace voxelpipe::cli {

// Below the output directory. A record is DIRECTORY/<output>.json and holds nothing that differs between two runs.
inline constexpr char kRecordDirectory[] = ".voxelpipe";

struct DoneRecord {
  std::string key;   // of what was done, see ItemKey
  std::string hash;  // SHA-256 of the result's bytes in stream order
  uint64_t bytes = 0;
  struct File {
    std::string name;  // relative to the output directory
    uint64_t bytes = 0;
  };
  std::vector<File> files;
  WarningList warnings{};
};

// In: an item and the SHA-256 of its input, siblings included. Out: 64 hexadecimal digits that are others as soon as
// the item would give other bytes or other files.
absl::StatusOr<std::string> ItemKey(const BatchItem& item, const std::string& input_sha256);

// The path of an item's record.
std::string RecordPath(const std::string& output_dir, const BatchItem& item);

// The record, if it is of this key and every file is there with its size: the item is finished. NOT_FOUND otherwise.
absl::StatusOr<DoneRecord> FindRecord(const std::string& output_dir, const BatchItem& item, const std::string& key);

// Takes the record away. Before an item's files change, so that no record ever speaks of files that it does not know.
absl::Status RemoveRecord(const std::string& output_dir, const BatchItem& item);

// Reads the sizes of `record.files` and writes the record, under a temporary name first.
absl::Status WriteRecord(const std::string& output_dir, const BatchItem& item, DoneRecord record);

}  // namespace voxelpipe::cli
