// Gathers host arrays into one block, so that they are uploaded in one copy.
#pragma once

#include <tbb/parallel_for.h>

#include <cstdint>
#include <cstring>
#include <vector>

namespace voxelpipe::cuda {

class UploadLayout {
 public:
  // Adds an array. Its address must stay valid until CopyTo; its contents may still change. Returns its offset in the
  // block, a multiple of 16 bytes.
  template <typename T>
  uint64_t Add(const T* from, uint64_t count) {
    const uint64_t at = bytes_;
    if (count > 0) arrays_.push_back({from, count * sizeof(T), at});
    bytes_ += (count * sizeof(T) + 15) / 16 * 16;
    return at;
  }
  uint64_t bytes() const { return bytes_; }

  // Copies all arrays into a block of bytes() bytes, with the threads of the calling thread's arena.
  void CopyTo(uint8_t* block) const {
    tbb::parallel_for(size_t{0}, arrays_.size(),
                      [&](size_t i) { std::memcpy(block + arrays_[i].at, arrays_[i].from, arrays_[i].bytes); });
  }

 private:
  struct Array {
    const void* from;
    uint64_t bytes, at;
  };
  std::vector<Array> arrays_;
  uint64_t bytes_ = 0;
};

}  // namespace voxelpipe::cuda
