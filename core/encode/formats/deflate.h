// zlib's compression, in streams and in blocks.
//
// Source: P. Deutsch, RFC 1950 to 1952 (zlib, deflate, gzip), 1996.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// zlib's fastest. Voxels are long runs, which higher levels hardly make smaller, but ten times slower.
inline constexpr int kDeflateLevel = 1;

// What compression takes besides its input and output: zlib's window and tables, and a buffer.
inline constexpr uint64_t kDeflateBytes = 384 << 10;

// `bytes` as one zlib stream, in pieces to `out`. `job` may be null. Errors: the job's and those of `out`. Throws
// std::bad_alloc.
absl::Status DeflateBlock(std::span<const uint8_t> bytes, const JobContext* job,
                          const std::function<absl::Status(std::span<const uint8_t>)>& out);
// The same in one piece.
absl::StatusOr<std::vector<uint8_t>> ZlibBlock(std::span<const uint8_t> bytes, const JobContext* job);
// The most memory that ZlibBlock allocates.
uint64_t ZlibBlockBytes(uint64_t bytes);

// A part of a deflate stream. It ends at a byte and refers to nothing before it, so that parts made at the same time
// follow each other in one stream. Allocates kDeflateBytes. Throws std::bad_alloc.
class DeflatePart {
 public:
  using Output = std::function<absl::Status(std::span<const uint8_t>)>;

  // `job` may be null; it must outlive this.
  explicit DeflatePart(const JobContext* job = nullptr);
  ~DeflatePart();
  DeflatePart(DeflatePart&&) noexcept;
  DeflatePart& operator=(DeflatePart&&) = delete;

  // Errors: the job's and those of `out`.
  absl::Status Write(std::span<const uint8_t> bytes, const Output& out);
  // Ends the part, but not the stream.
  absl::Status Finish(const Output& out);

  uint64_t bytes() const { return bytes_; }  // before compression
  uint32_t crc() const { return crc_; }      // CRC-32 of them

 private:
  absl::Status Run(int flush, const Output& out);

  struct State;
  std::unique_ptr<State> state_;
  const JobContext* job_;
  uint64_t bytes_ = 0;
  uint32_t crc_ = 0;
};

// A gzip file: GzipHeader, finished parts in order, then GzipEnd of them.
std::string GzipHeader();
std::string GzipEnd(const std::vector<DeflatePart>& parts);

}  // namespace voxelpipe
