// SHA-256 of results.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "base/checksum/sha256.h"
#include "job/result.h"

namespace voxelpipe::cli {

// A sink that counts and hashes the bytes, and forwards them to `next`, if there is one.
class HashingSink final : public ResultSink {
 public:
  // `next` may be null and must outlive the object.
  explicit HashingSink(ResultSink* next) : next_(next) {}

  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

  const ResultHeader& header() const { return header_; }
  uint64_t bytes() const { return bytes_; }
  // SHA-256 of all bytes in stream order, 64 lower-case hexadecimal digits. Once, at the end.
  std::string Digest() { return hash_.HexDigest(); }

 private:
  Sha256 hash_;
  ResultSink* next_;
  ResultHeader header_;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe::cli
