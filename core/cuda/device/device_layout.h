// Offsets of several arrays within one allocation of device memory.
#pragma once

#include <cstdint>

#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// Every array starts at a multiple of 16 bytes.
class BlockLayout {
 public:
  template <typename T>
  uint64_t Add(uint64_t count) {
    const uint64_t begin = bytes_;
    bytes_ += (count * sizeof(T) + 15) / 16 * 16;
    return begin;
  }
  uint64_t bytes() const { return bytes_; }

 private:
  uint64_t bytes_ = 0;
};

template <typename T>
T* At(DeviceArray<uint8_t>& block, uint64_t offset) {
  return reinterpret_cast<T*>(block.data() + offset);
}

}  // namespace voxelpipe::cuda
