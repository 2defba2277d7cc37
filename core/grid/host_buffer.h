// Bytes on the host, not initialized, movable, 64-byte aligned.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>

#include "absl/status/statusor.h"

namespace voxelpipe {

class HostBuffer {
 public:
  HostBuffer() = default;

  // RESOURCE_EXHAUSTED naming the size when the system has no memory for it. Contents undefined.
  static absl::StatusOr<HostBuffer> Allocate(uint64_t bytes);

  uint8_t* data() { return data_.get(); }
  const uint8_t* data() const { return data_.get(); }
  uint64_t size() const { return size_; }
  std::span<const uint8_t> bytes() const { return {data_.get(), size_}; }
  std::span<uint8_t> bytes() { return {data_.get(), size_}; }

 private:
  struct Free {
    void operator()(uint8_t* p) const { std::free(p); }
  };
  std::unique_ptr<uint8_t[], Free> data_;
  uint64_t size_ = 0;
};

}  // namespace voxelpipe
