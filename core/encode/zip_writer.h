// ZIP archives of stored entries, written front to back.
//
// Source: PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", version 6.3.10.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "encode/atomic_file.h"

namespace voxelpipe {

// Entries may be of any size (ZIP64). Sizes are written before an entry's bytes, checksums after them.
class ZipWriter {
 public:
  // `file` and `job` must outlive the object; `job` may be null.
  ZipWriter(AtomicFile& file, const JobContext* job) : file_(file), job_(job) {}

  absl::Status BeginEntry(const std::string& name, uint64_t bytes);
  absl::Status Write(std::span<const uint8_t> bytes);
  // INTERNAL if the entry did not get the announced number of bytes.
  absl::Status EndEntry();
  // The central directory.
  absl::Status Finish();

 private:
  struct Entry {
    std::string name;
    uint64_t offset, bytes;
    uint32_t crc;
  };

  absl::Status Put(const std::string& record);

  AtomicFile& file_;
  const JobContext* job_;
  std::vector<Entry> entries_;
  uint64_t at_ = 0;       // bytes written
  uint64_t written_ = 0;  // of the open entry
};

}  // namespace voxelpipe
