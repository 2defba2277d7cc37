// A file that is read in pieces at any place.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

class InputFile {
 public:
  // Errors, with the path: NOT_FOUND, INVALID_ARGUMENT for what is not a regular file, otherwise the system's.
  static absl::StatusOr<std::shared_ptr<const InputFile>> Open(const std::string& path);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::string& path() const { return path_; }
  uint64_t bytes() const { return bytes_; }  // when it was opened

  // Fills `out` with the bytes from `offset` on. Errors, with path and byte: DATA_LOSS if the file ends before,
  // otherwise the system's. Thread-safe.
  absl::Status ReadAt(uint64_t offset, std::span<uint8_t> out) const;

 private:
  InputFile(std::string path, int descriptor, uint64_t bytes)
      : path_(std::move(path)), descriptor_(descriptor), bytes_(bytes) {}

  std::string path_;
  int descriptor_;
  uint64_t bytes_;
};

}  // namespace voxelpipe
