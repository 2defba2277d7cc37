// Records of finished items of a batch: a small file for each item, written after the item's own files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/warning.h"
#include "batch/item_parser.h"

namespace voxelpipe::cli {

// Below the output directory. A record is DIRECTORY/<output>.json and has the same contents in every run.
inline constexpr char kRecordDirectory[] = ".voxelpipe";

struct DoneRecord {
  std::string key;   // of the item, see ItemKey
  std::string hash;  // SHA-256 of the result's bytes in stream order
  uint64_t bytes = 0;
  struct File {
    std::string name;  // relative to the output directory
    uint64_t bytes = 0;
  };
  std::vector<File> files;
  WarningList warnings{};
};

// In: an item and the SHA-256 of its input, siblings included. Out: 64 hexadecimal digits that change if the item would
// produce other bytes or other files.
absl::StatusOr<std::string> ItemKey(const BatchItem& item, const std::string& input_sha256);

// The path of an item's record.
std::string RecordPath(const std::string& output_dir, const BatchItem& item);

// The record, if it has this key and every file exists with its size: the item is finished. NOT_FOUND otherwise.
absl::StatusOr<DoneRecord> FindRecord(const std::string& output_dir, const BatchItem& item, const std::string& key);

// Removes the record. Called before an item's files change, so that a record never describes other files.
absl::Status RemoveRecord(const std::string& output_dir, const BatchItem& item);

// Reads the sizes of `record.files` and writes the record, under a temporary name first.
absl::Status WriteRecord(const std::string& output_dir, const BatchItem& item, DoneRecord record);

}  // namespace voxelpipe::cli
