// A recorded sequence of kernel launches with their arguments, so that it can be launched as one CUDA graph
// (graph_cache.h). Included by .cu files and by graph_cache.cpp only.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "cuda/device/device_caps.h"

namespace voxelpipe::cuda {

// When a kernel may start: after the previous kernel ended; by programmatic dependent launch (dependent_launch.cuh);
// after the previous kernel, with all blocks resident (a cooperative launch).
enum class Begins { kBehind, kEarly, kAtOnce };

inline Begins EarlyIfAble(const DeviceInfo& device) {
  return BeginsEarly(device) ? Begins::kEarly : Begins::kBehind;
}

struct ListedLaunch {
  const char* name;  // for error messages
  const void* kernel;
  // Launches the kernel with the arguments that the pointers point to.
  cudaError_t (*launch)(const cudaLaunchConfig_t& config, const void* kernel, void* const* arguments);
  dim3 blocks;
  unsigned threads;
  Begins begins;
  size_t first_argument, arguments;  // range in LaunchList::places_

  // True if only the arguments may differ.
  bool IsLike(const ListedLaunch& other) const {
    return kernel == other.kernel && blocks.x == other.blocks.x && blocks.y == other.blocks.y &&
           blocks.z == other.blocks.z && threads == other.threads && begins == other.begins;
  }
};

class LaunchList {
 public:
  // `name` is the kernel's name, a string literal.
  template <typename... Parameters>
  void Add(const char* name, Begins begins, dim3 blocks, unsigned threads, void (*kernel)(Parameters...),
           const std::type_identity_t<Parameters>&... arguments) {
    static_assert((std::is_trivially_copyable_v<Parameters> && ...));
    static_assert(((alignof(Parameters) <= kAlignment) && ...));
    launches_.push_back({name, reinterpret_cast<const void*>(kernel), &LaunchOf<Parameters...>, blocks, threads, begins,
                         places_.size(), sizeof...(Parameters)});
    (Keep(&arguments, sizeof arguments), ...);
  }

  std::span<const ListedLaunch> launches() const { return launches_; }
  // Pointers to the arguments of a launch, in CUDA's form. Valid until the list changes.
  std::vector<void*> ArgumentsOf(const ListedLaunch& launch) const {
    std::vector<void*> pointers(launch.arguments);
    for (size_t i = 0; i < launch.arguments; ++i) {
      pointers[i] = const_cast<std::byte*>(bytes_.data() + places_[launch.first_argument + i]);
    }
    return pointers;
  }
  // True if every launch is like the corresponding one of `other`.
  bool IsLike(const LaunchList& other) const {
    if (launches_.size() != other.launches_.size()) return false;
    for (size_t i = 0; i < launches_.size(); ++i) {
      if (!launches_[i].IsLike(other.launches_[i])) return false;
    }
    return true;
  }
  // True if launch `i` has the same arguments as in `other`, a list like this one. Compares padding too, so it may
  // return false for equal arguments.
  bool HasArgumentsOf(const LaunchList& other, size_t i) const {
    const size_t begin = BytesBefore(i), end = BytesBefore(i + 1);
    return std::memcmp(bytes_.data() + begin, other.bytes_.data() + begin, end - begin) == 0;
  }

 private:
  static constexpr size_t kAlignment = 16;

  // Typed, so that the emulator, which calls kernels on the host, can call it.
  template <typename... Parameters>
  static cudaError_t LaunchOf(const cudaLaunchConfig_t& config, const void* kernel, void* const* arguments) {
    return LaunchWith<Parameters...>(config, kernel, arguments, std::index_sequence_for<Parameters...>());
  }
  template <typename... Parameters, size_t... kIndex>
  static cudaError_t LaunchWith(const cudaLaunchConfig_t& config, const void* kernel,
                                [[maybe_unused]] void* const* arguments, std::index_sequence<kIndex...>) {
    auto* const typed = reinterpret_cast<void (*)(Parameters...)>(const_cast<void*>(kernel));
    return cudaLaunchKernelEx(&config, typed, *static_cast<const Parameters*>(arguments[kIndex])...);
  }

  void Keep(const void* argument, size_t size) {
    const size_t at = (bytes_.size() + kAlignment - 1) / kAlignment * kAlignment;
    places_.push_back(at);
    bytes_.resize(at + size);
    std::memcpy(bytes_.data() + at, argument, size);
  }
  size_t BytesBefore(size_t launch) const {
    if (launch == launches_.size()) return bytes_.size();
    const size_t first = launches_[launch].first_argument;
    return first == places_.size() ? bytes_.size() : places_[first];
  }

  std::vector<ListedLaunch> launches_;
  std::vector<size_t> places_;  // offsets of the arguments in bytes_
  std::vector<std::byte> bytes_;
};

}  // namespace voxelpipe::cuda
