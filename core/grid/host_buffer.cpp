#include "grid/host_buffer.h"

#include "absl/strings/str_cat.h"

namespace voxelpipe {

absl::StatusOr<HostBuffer> HostBuffer::Allocate(uint64_t bytes) {
  HostBuffer buffer;
  buffer.data_ =
      decltype(buffer.data_)(static_cast<uint8_t*>(TakePages(bytes)), host_buffer_internal::GiveBack{.bytes = bytes});
  if (buffer.data_ == nullptr) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory: no ", bytes, " bytes for a result"));
  }
  buffer.size_ = bytes;
  return buffer;
}

void HostBuffer::Discard() {
  if (data_ != nullptr && data_.get_deleter().give_back == &ReturnPages) data_.get_deleter().give_back = &DiscardPages;
  data_.reset();
  data_.get_deleter().give_back = &ReturnPages;
  size_ = 0;
}

HostBuffer HostBuffer::Adopt(void* block, uint64_t bytes, void (*give_back)(void* block, uint64_t bytes)) {
  HostBuffer buffer;
  buffer.data_ = decltype(buffer.data_)(static_cast<uint8_t*>(block), {bytes, give_back});
  buffer.size_ = bytes;
  return buffer;
}

}  // namespace voxelpipe
