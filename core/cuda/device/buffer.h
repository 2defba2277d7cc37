// Arrays in device memory, allocated from the device's stream-ordered pool. All device memory is allocated here.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>
#include <utility>

#include "absl/status/status.h"
#include "cuda/device/check.h"

namespace voxelpipe::cuda {

// The status with the number of bytes needed in front of its message.
absl::Status NeedStatus(const absl::Status& status, uint64_t bytes);  // device.cpp

// Charges `bytes` to the limit of LimitMemory (device.h). False if that would exceed it. Thread-safe.
bool TakeMemory(uint64_t bytes);    // device.cpp
void ReturnMemory(uint64_t bytes);  // device.cpp
absl::Status LimitStatus(uint64_t bytes);

// Uninitialized elements of a trivially copyable T. The size is rounded up to 16 bytes, so stores of uint4 may end past
// the last element. Allocation and release are ordered on the stream of the last Resize: all work on the array must
// have been queued on that stream. Never synchronizes.
template <typename T>
class DeviceArray {
 public:
  DeviceArray() = default;
  DeviceArray(DeviceArray&& other) noexcept { *this = std::move(other); }
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
    std::swap(stream_, other.stream_);
    return *this;
  }
  ~DeviceArray() { Free(); }

  // Sets size() to count. Contents are lost unless the capacity was large enough. RESOURCE_EXHAUSTED names the size
  // needed.
  absl::Status Resize(uint64_t count, cudaStream_t stream) {
    if (count > capacity_) {
      Free();
      stream_ = stream;
      void* p = nullptr;
      if (!TakeMemory(RoundedBytes(count))) return LimitStatus(count * sizeof(T));
      if (const cudaError_t error = cudaMallocAsync(&p, RoundedBytes(count), stream); error != cudaSuccess) {
        ReturnMemory(RoundedBytes(count));
        return NeedStatus(CudaStatus(error, "cudaMallocAsync", __FILE__, __LINE__), count * sizeof(T));
      }
      data_ = static_cast<T*>(p);
      capacity_ = count;
    }
    size_ = count;
    return absl::OkStatus();
  }
  void Free() {
    if (data_ != nullptr) {
      (void)cudaFreeAsync(data_, stream_);
      ReturnMemory(RoundedBytes(capacity_));
    }
    data_ = nullptr;
    size_ = capacity_ = 0;
  }

  T* data() { return data_; }
  const T* data() const { return data_; }
  uint64_t size() const { return size_; }
  uint64_t bytes() const { return size_ * sizeof(T); }
  bool empty() const { return size_ == 0; }

  // Sets every byte of the array to `byte`.
  absl::Status Fill(int byte, cudaStream_t stream) {
    if (size_ > 0) VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(data_, byte, bytes(), stream));
    return absl::OkStatus();
  }
  // Resizes and copies from the host. Pageable memory is staged before the call returns.
  absl::Status Upload(std::span<const T> from, cudaStream_t stream) {
    if (absl::Status s = Resize(from.size(), stream); !s.ok()) return s;
    if (!from.empty()) {
      VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(data_, from.data(), from.size_bytes(), cudaMemcpyHostToDevice, stream));
    }
    return absl::OkStatus();
  }

 private:
  static uint64_t RoundedBytes(uint64_t count) { return (count * sizeof(T) + 15) / 16 * 16; }

  T* data_ = nullptr;
  uint64_t size_ = 0, capacity_ = 0;
  cudaStream_t stream_ = nullptr;
};

}  // namespace voxelpipe::cuda
