// SHA-256, of results above all.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "job/result.h"

namespace voxelpipe::cli {

// 64 lower-case hexadecimal digits.
absl::StatusOr<std::string> Sha256Hex(std::span<const uint8_t> bytes);

// Counts and hashes what passes, and hands it on to `next`, if there is one.
class HashingSink final : public ResultSink {
 public:
  // `next` may be null and must outlive the object.
  explicit HashingSink(ResultSink* next);
  ~HashingSink() override;

  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;

  const ResultHeader& header() const { return header_; }
  uint64_t bytes() const { return bytes_; }
  // SHA-256 of all bytes in stream order, 64 lower-case hexadecimal digits. Once, at the end.
  absl::StatusOr<std::string> Digest();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
  ResultSink* next_;
  ResultHeader header_;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe::cli
