// The list of jobs of `voxelpipe batch`: JSONL, one object a line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "batch/item_parser.h"
#include "batch/shard.h"

namespace voxelpipe::cli {

// A whole manifest, without parsing it.
struct ManifestFacts {
  uint64_t items = 0;  // lines that are not blank
  std::string sha256;  // of the lines, 64 hexadecimal digits
};

// Calls `on_item`, if there is one, with each line that is not blank: its number, from 1, and its item's, from 0.
// Errors: NOT_FOUND and those of the system, with the path.
using OnItemLine = std::function<void(size_t line, size_t item, std::string_view text)>;
absl::StatusOr<ManifestFacts> ScanManifest(const std::string& path, const OnItemLine& on_item = {});

// The items of a shard of a manifest, in order, read as they are asked for. Memory holds the items of the first
// kCheckedLines lines, and a fingerprint of 16 bytes of each file and id of the lines read, those of other shards too,
// by which two items with one name are found. Each line is an object, as ItemParser takes it, or blank. Errors:
// INVALID_ARGUMENT "FILE:LINE: what is wrong" for the first line at fault; NOT_FOUND and the system's errors if the
// manifest cannot be read.
class ManifestReader {
 public:
  static constexpr size_t kCheckedLines = 10000, kCheckedBytes = size_t{16} << 20;

  // Reads and checks the first kCheckedLines lines, or fewer that have kCheckedBytes together. What is no regular file
  // is copied to a temporary one first.
  static absl::StatusOr<ManifestReader> Open(const std::string& path, const ManifestDefaults& defaults,
                                             const Shard& shard = {});
  ManifestReader(ManifestReader&&) noexcept;
  ManifestReader& operator=(ManifestReader&&) = delete;
  ~ManifestReader();

  // The next item; empty at the end. After an error, the same error again. Not from several threads at once.
  absl::StatusOr<std::optional<BatchItem>> Next();

  // Of all items, with one more pass over the file. From any thread.
  absl::StatusOr<ManifestFacts> Scan() const;

 private:
  class Impl;
  explicit ManifestReader(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe::cli
