// Memory that two processes share: one writes, one reads.
#pragma once

#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

// A memory file of fixed size, so that reading its mapping never faults. It is as large as any message, and takes
// memory only for written pages. Not thread-safe.
class SharedRegion {
 public:
  static constexpr uint64_t kBytes = uint64_t{256} << 30;

  // Errors: those of the system.
  static absl::StatusOr<SharedRegion> Create();
  // From a descriptor that another process made with Create; takes ownership.
  explicit SharedRegion(int fd) : fd_(fd) {}
  SharedRegion(SharedRegion&& other) noexcept
      : fd_(std::exchange(other.fd_, -1)),
        data_(std::exchange(other.data_, nullptr)),
        mapped_(std::exchange(other.mapped_, 0)) {}
  SharedRegion& operator=(SharedRegion&& other) = delete;
  ~SharedRegion();

  int fd() const { return fd_; }
  // The first `bytes` bytes, mapped until the next call. RESOURCE_EXHAUSTED if they do not fit.
  absl::StatusOr<uint8_t*> Map(uint64_t bytes);
  // Its memory in bytes.
  uint64_t resident_bytes() const;
  // Releases the memory of all but the first `bytes` bytes, which then reads as zeros.
  void ShrinkTo(uint64_t bytes);

 private:
  int fd_ = -1;
  uint8_t* data_ = nullptr;
  uint64_t mapped_ = 0;
};

}  // namespace voxelpipe
