#include "grid/host_buffer.h"

#include "absl/strings/str_cat.h"

namespace voxelpipe {

absl::StatusOr<HostBuffer> HostBuffer::Allocate(uint64_t bytes) {
  constexpr uint64_t kAlignment = 64;
  HostBuffer buffer;
  if (bytes > UINT64_MAX - kAlignment) {
    return absl::ResourceExhaustedError(absl::StrCat("a buffer of ", bytes, " bytes cannot exist"));
  }
  const uint64_t rounded = (bytes + kAlignment - 1) / kAlignment * kAlignment;
  buffer.data_.reset(static_cast<uint8_t*>(std::aligned_alloc(kAlignment, rounded == 0 ? kAlignment : rounded)));
  if (buffer.data_ == nullptr) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory: no ", bytes, " bytes for a result"));
  }
  buffer.size_ = bytes;
  return buffer;
}

}  // namespace voxelpipe
