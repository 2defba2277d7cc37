// CUB's device-wide functions, in plain loops.
#pragma once

#include <cstdint>
#include <numeric>
#include <vector>

#include "cuda_runtime_api.h"

namespace cub {

template <typename T>
struct DoubleBuffer {
  T* buffers[2] = {nullptr, nullptr};
  int selector = 0;
  DoubleBuffer(T* current, T* other) : buffers{current, other} {}
  T* Current() { return buffers[selector]; }
  T* Alternate() { return buffers[selector ^ 1]; }
};

struct DeviceRadixSort {
  template <typename Key, typename Value, typename Count>
  static cudaError_t SortPairs(void* scratch, size_t& bytes, const Key* keys_in, Key* keys_out, const Value* values_in,
                               Value* values_out, Count count, int begin_bit = 0, int end_bit = sizeof(Key) * 8,
                               cudaStream_t = nullptr) {
    if (scratch == nullptr) return bytes = 1, cudaSuccess;
    const Key all = Key(~Key{0}), below = end_bit >= int(sizeof(Key) * 8) ? all : Key((Key{1} << end_bit) - 1);
    const auto part = [&](Key key) { return Key((key & below) >> begin_bit); };
    std::vector<uint64_t> order(count);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](uint64_t a, uint64_t b) { return part(keys_in[a]) < part(keys_in[b]); });
    const std::vector<Key> keys(keys_in, keys_in + count);
    const std::vector<Value> values(values_in, values_in + count);
    for (uint64_t i = 0; i < uint64_t(count); ++i) {
      keys_out[i] = keys[order[i]];
      values_out[i] = values[order[i]];
    }
    return cudaSuccess;
  }
  template <typename Key, typename Count>
  static cudaError_t SortKeys(void* scratch, size_t& bytes, DoubleBuffer<Key>& keys, Count count, int begin_bit = 0,
                              int end_bit = sizeof(Key) * 8, cudaStream_t stream = nullptr) {
    DoubleBuffer<Key> values(keys.Current(), keys.Alternate());
    const cudaError_t error = SortPairs(scratch, bytes, keys, values, count, begin_bit, end_bit, stream);
    return error;
  }
  template <typename Key, typename Value, typename Count>
  static cudaError_t SortPairs(void* scratch, size_t& bytes, DoubleBuffer<Key>& keys, DoubleBuffer<Value>& values,
                               Count count, int begin_bit = 0, int end_bit = sizeof(Key) * 8,
                               cudaStream_t stream = nullptr) {
    const cudaError_t error = SortPairs(scratch, bytes, keys.Current(), keys.Alternate(), values.Current(),
                                        values.Alternate(), count, begin_bit, end_bit, stream);
    if (scratch != nullptr) keys.selector ^= 1, values.selector ^= 1;
    return error;
  }
};

struct DeviceScan {
  template <typename In, typename Out, typename Op, typename Init, typename Count>
  static cudaError_t ExclusiveScan(void* scratch, size_t& bytes, In in, Out out, Op op, Init init, Count count,
                                   cudaStream_t = nullptr) {
    if (scratch == nullptr) return bytes = 1, cudaSuccess;
    Init sum = init;
    for (uint64_t i = 0; i < uint64_t(count); ++i) {
      const auto value = in[i];
      out[i] = sum;
      sum = Init(op(sum, Init(value)));
    }
    return cudaSuccess;
  }
  template <typename In, typename Out, typename Count>
  static cudaError_t ExclusiveSum(void* scratch, size_t& bytes, In in, Out out, Count count, cudaStream_t s = nullptr) {
    return ExclusiveScan(
        scratch, bytes, in, out, [](auto a, auto b) { return a + b; }, std::remove_cvref_t<decltype(out[0])>{}, count,
        s);
  }
};

struct DeviceSelect {
  template <typename In, typename Flags, typename Out, typename Selected, typename Count>
  static cudaError_t Flagged(void* scratch, size_t& bytes, In in, Flags flags, Out out, Selected selected, Count count,
                             cudaStream_t = nullptr) {
    if (scratch == nullptr) return bytes = 1, cudaSuccess;
    uint64_t found = 0;
    for (uint64_t i = 0; i < uint64_t(count); ++i) {
      if (flags[i]) out[found++] = in[i];
    }
    *selected = found;
    return cudaSuccess;
  }
  template <typename In, typename Out, typename Selected, typename Count, typename Wanted>
  static cudaError_t If(void* scratch, size_t& bytes, In in, Out out, Selected selected, Count count, Wanted wanted,
                        cudaStream_t = nullptr) {
    if (scratch == nullptr) return bytes = 1, cudaSuccess;
    uint64_t found = 0;
    for (uint64_t i = 0; i < uint64_t(count); ++i) {
      const auto value = in[i];
      if (wanted(value)) out[found++] = value;
    }
    *selected = found;
    return cudaSuccess;
  }
};

}  // namespace cub
