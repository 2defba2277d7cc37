// Bytes on the host, not initialized, movable, 64-byte aligned; large ones come from a pool (page_pool.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <type_traits>

#include "absl/status/statusor.h"
#include "grid/page_pool.h"

namespace voxelpipe {

namespace host_buffer_internal {
struct GiveBack {
  uint64_t bytes = 0;
  void (*give_back)(void* block, uint64_t bytes) = &ReturnPages;
  void operator()(uint8_t* p) const { give_back(p, bytes); }
};
}  // namespace host_buffer_internal

class HostBuffer {
 public:
  HostBuffer() = default;
  HostBuffer(HostBuffer&& other) noexcept : data_(std::move(other.data_)), size_(other.size_) { other.size_ = 0; }
  HostBuffer& operator=(HostBuffer&& other) noexcept {
    data_ = std::move(other.data_);
    size_ = other.size_;
    other.size_ = 0;
    return *this;
  }

  // RESOURCE_EXHAUSTED naming the size if memory is short. Contents undefined.
  static absl::StatusOr<HostBuffer> Allocate(uint64_t bytes);
  // Wraps a block of another owner, to whom give_back(block, bytes) returns it, from any thread.
  static HostBuffer Adopt(void* block, uint64_t bytes, void (*give_back)(void* block, uint64_t bytes));

  // Frees the bytes to the system instead of the pool, for callers whose next buffer has another size. size() is 0
  // afterwards.
  void Discard();

  uint8_t* data() { return data_.get(); }
  const uint8_t* data() const { return data_.get(); }
  uint64_t size() const { return size_; }
  std::span<const uint8_t> bytes() const { return {data_.get(), size_}; }
  std::span<uint8_t> bytes() { return {data_.get(), size_}; }

 private:
  std::unique_ptr<uint8_t[], host_buffer_internal::GiveBack> data_;
  uint64_t size_ = 0;
};

// An array of plain values in a HostBuffer: like a vector that does not initialize.
template <typename T>
class HostArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  HostArray() = default;
  // Contents undefined. Throws std::bad_alloc.
  explicit HostArray(uint64_t count) {
    if (count > UINT64_MAX / sizeof(T)) throw std::bad_alloc();
    absl::StatusOr<HostBuffer> buffer = HostBuffer::Allocate(count * sizeof(T));
    if (!buffer.ok()) throw std::bad_alloc();
    buffer_ = *std::move(buffer);
  }

  T* data() { return reinterpret_cast<T*>(buffer_.data()); }
  const T* data() const { return reinterpret_cast<const T*>(buffer_.data()); }
  uint64_t size() const { return buffer_.size() / sizeof(T); }
  bool empty() const { return size() == 0; }
  T& operator[](uint64_t i) { return data()[i]; }
  const T& operator[](uint64_t i) const { return data()[i]; }

 private:
  HostBuffer buffer_;
};

}  // namespace voxelpipe
