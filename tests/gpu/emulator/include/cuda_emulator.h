// Runs CUDA kernels on the host: every thread of a block is a fiber, blocks run one after the other. Included before
// everything else in a translation unit that translate.py made of a .cu file.
//
// What it finds: wrong results, barriers that not all threads reach, lanes missing from a warp's exchange, and with
// AddressSanitizer accesses outside of allocations. With cuda_races.h races, too; without, only those that some order
// of its own shows (CUDA_EMULATOR_SHUFFLE=1 in the environment changes the order of threads). What it does not: time.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <type_traits>
#include <utility>

#define __CUDACC__ 1
#define __host__
#define __device__
#define __global__
#define __constant__
#define __noinline__
#define __forceinline__ inline
#define __launch_bounds__(...)
#define __grid_constant__

#include "cuda_races.h"
#include "cuda_runtime_api.h"

struct alignas(8) uint2 {
  uint32_t x, y;
};
struct alignas(16) uint4 {
  uint32_t x, y, z, w;
};
struct alignas(8) float2 {
  float x, y;
};
struct alignas(16) float4 {
  float x, y, z, w;
};
struct alignas(16) double2 {
  double x, y;
};
struct alignas(16) ulonglong2 {
  unsigned long long x, y;
};
inline uint2 make_uint2(uint32_t x, uint32_t y) {
  return {x, y};
}
inline uint4 make_uint4(uint32_t x, uint32_t y, uint32_t z, uint32_t w) {
  return {x, y, z, w};
}

namespace cuda_emulator {

struct Config {
  dim3 grid, block;
  size_t shared = 0;
  cudaStream_t stream = nullptr;
  bool early = false;  // it may begin before the one before it has ended
};

// Runs `thread` for every thread of every block.
void RunKernel(const Config& config, const std::function<void()>& thread);

template <typename Kernel, typename... Arguments>
void Launch(const Config& config, const Kernel& kernel, const Arguments&... arguments) {
  RunKernel(config, [&] { kernel(arguments...); });
}

void* DynamicShared();

// Rendezvous of the block's threads that still run; the or and the sum of what they bring.
struct Gathered {
  bool any, all;
  int count;
};
Gathered BlockBarrier(bool predicate);

// Rendezvous of the lanes in `mask` that still run: what each brought, 0 of those that did not come; `came` has their
// bits. `orders`: what they did before comes before what they do next.
struct Lanes {
  uint64_t value[32];
  uint32_t came;
};
const Lanes& WarpExchange(uint32_t mask, uint64_t value, bool orders = false);
unsigned Lane();

template <typename T>
uint64_t ToBits(T value) {
  static_assert(sizeof(T) <= 8);
  uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof value);
  return bits;
}
template <typename T>
T FromBits(uint64_t bits) {
  T value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

struct Built {
  dim3 thread, block, block_dim, grid_dim;
};
extern Built built_in;

}  // namespace cuda_emulator

// One kernel after the other, whatever the attributes allow.
template <typename... Parameters, typename... Arguments>
cudaError_t cudaLaunchKernelEx(const cudaLaunchConfig_t* config, void (*kernel)(Parameters...),
                               const Arguments&... arguments) {
  const bool early = config->numAttrs > 0 && config->attrs[0].id == cudaLaunchAttributeProgrammaticStreamSerialization;
  ::cuda_emulator::Launch({config->gridDim, config->blockDim, config->dynamicSmemBytes, config->stream, early}, kernel,
                          arguments...);
  return cudaSuccess;
}

#define threadIdx (::cuda_emulator::built_in.thread)
#define blockIdx (::cuda_emulator::built_in.block)
#define blockDim (::cuda_emulator::built_in.block_dim)
#define gridDim (::cuda_emulator::built_in.grid_dim)
inline constexpr int warpSize = 32;

inline void __syncthreads() {
  (void)cuda_emulator::BlockBarrier(false);
}
inline int __syncthreads_or(int predicate) {
  return cuda_emulator::BlockBarrier(predicate != 0).any;
}
inline int __syncthreads_and(int predicate) {
  return cuda_emulator::BlockBarrier(predicate != 0).all;
}
inline int __syncthreads_count(int predicate) {
  return cuda_emulator::BlockBarrier(predicate != 0).count;
}
inline void __syncwarp(uint32_t mask = ~0u) {
  (void)cuda_emulator::WarpExchange(mask, 0, true);
}
inline void __threadfence() {
  cuda_emulator::races::Fence();
}
inline void __threadfence_block() {
  cuda_emulator::races::Fence();
}

// Lanes that happen to run together: here none does.
inline uint32_t __activemask() {
  return 1u << cuda_emulator::Lane();
}

template <typename T>
T __shfl_sync(uint32_t mask, T value, int lane, int width = 32) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, cuda_emulator::ToBits(value));
  const unsigned base = cuda_emulator::Lane() & ~unsigned(width - 1);
  return cuda_emulator::FromBits<T>(lanes.value[base + (unsigned(lane) & unsigned(width - 1))]);
}
template <typename T>
T __shfl_up_sync(uint32_t mask, T value, unsigned by, int width = 32) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, cuda_emulator::ToBits(value));
  const unsigned lane = cuda_emulator::Lane(), in_group = lane & unsigned(width - 1);
  return in_group < by ? value : cuda_emulator::FromBits<T>(lanes.value[lane - by]);
}
template <typename T>
T __shfl_down_sync(uint32_t mask, T value, unsigned by, int width = 32) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, cuda_emulator::ToBits(value));
  const unsigned lane = cuda_emulator::Lane(), in_group = lane & unsigned(width - 1);
  return in_group + by >= unsigned(width) ? value : cuda_emulator::FromBits<T>(lanes.value[lane + by]);
}
template <typename T>
T __shfl_xor_sync(uint32_t mask, T value, unsigned with, int = 32) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, cuda_emulator::ToBits(value));
  return cuda_emulator::FromBits<T>(lanes.value[(cuda_emulator::Lane() ^ with) & 31]);
}
inline uint32_t __ballot_sync(uint32_t mask, int predicate) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, predicate != 0);
  uint32_t bits = 0;
  for (int i = 0; i < 32; ++i) bits |= uint32_t(lanes.value[i] != 0) << i;
  return bits & lanes.came;
}
inline int __any_sync(uint32_t mask, int predicate) {
  return __ballot_sync(mask, predicate) != 0;
}
inline int __all_sync(uint32_t mask, int predicate) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, predicate == 0);
  for (const uint64_t value : lanes.value) {
    if (value != 0) return 0;
  }
  return 1;
}
template <typename T>
uint32_t __match_any_sync(uint32_t mask, T value) {
  const uint64_t mine = cuda_emulator::ToBits(value);
  const auto& lanes = cuda_emulator::WarpExchange(mask, mine);
  uint32_t bits = 0;
  for (int i = 0; i < 32; ++i) bits |= uint32_t(lanes.value[i] == mine) << i;
  return bits & lanes.came;
}
template <typename Reduce>
uint32_t EmulatedReduce(uint32_t mask, uint32_t value, Reduce&& reduce) {
  const auto& lanes = cuda_emulator::WarpExchange(mask, value);
  bool first = true;
  uint32_t result = 0;
  for (int i = 0; i < 32; ++i) {
    if ((lanes.came >> i & 1) == 0) continue;
    result = first ? uint32_t(lanes.value[i]) : reduce(result, uint32_t(lanes.value[i]));
    first = false;
  }
  return result;
}
inline uint32_t __reduce_add_sync(uint32_t mask, uint32_t v) {
  return EmulatedReduce(mask, v, [](uint32_t a, uint32_t b) { return a + b; });
}
inline uint32_t __reduce_or_sync(uint32_t mask, uint32_t v) {
  return EmulatedReduce(mask, v, [](uint32_t a, uint32_t b) { return a | b; });
}
inline uint32_t __reduce_max_sync(uint32_t mask, uint32_t v) {
  return EmulatedReduce(mask, v, [](uint32_t a, uint32_t b) { return a > b ? a : b; });
}
inline uint32_t __reduce_min_sync(uint32_t mask, uint32_t v) {
  return EmulatedReduce(mask, v, [](uint32_t a, uint32_t b) { return a < b ? a : b; });
}

inline int __double2loint(double v) {
  return int(uint32_t(std::bit_cast<uint64_t>(v)));
}
inline int __double2hiint(double v) {
  return int(uint32_t(std::bit_cast<uint64_t>(v) >> 32));
}
inline float rsqrtf(float v) {
  return 1.0f / std::sqrt(v);
}

inline int __popc(uint32_t v) {
  return std::popcount(v);
}
inline int __popcll(unsigned long long v) {
  return std::popcount(v);
}
inline int __ffs(int v) {
  return v == 0 ? 0 : std::countr_zero(uint32_t(v)) + 1;
}
inline int __ffsll(long long v) {
  return v == 0 ? 0 : std::countr_zero(static_cast<unsigned long long>(v)) + 1;
}
template <typename Choose>
uint32_t EmulatedHalves(uint32_t a, uint32_t b, Choose&& choose) {
  return uint32_t(choose(a & 0xffff, b & 0xffff)) | uint32_t(choose(a >> 16, b >> 16)) << 16;
}
inline uint32_t __vminu2(uint32_t a, uint32_t b) {
  return EmulatedHalves(a, b, [](uint32_t x, uint32_t y) { return x < y ? x : y; });
}
inline uint32_t __vmaxu2(uint32_t a, uint32_t b) {
  return EmulatedHalves(a, b, [](uint32_t x, uint32_t y) { return x > y ? x : y; });
}
// Without the selector's sign bits.
inline uint32_t __byte_perm(uint32_t a, uint32_t b, uint32_t selector) {
  const uint64_t bytes = uint64_t{b} << 32 | a;
  uint32_t result = 0;
  for (int i = 0; i < 4; ++i) result |= uint32_t(bytes >> 8 * (selector >> 4 * i & 7) & 0xff) << 8 * i;
  return result;
}
inline int __clz(int v) {
  return std::countl_zero(uint32_t(v));
}
inline int __clzll(long long v) {
  return std::countl_zero(static_cast<unsigned long long>(v));
}
inline uint32_t __brev(uint32_t v) {
  uint32_t out = 0;
  for (int i = 0; i < 32; ++i) out |= (v >> i & 1) << (31 - i);
  return out;
}
inline uint32_t __funnelshift_l(uint32_t lo, uint32_t hi, uint32_t by) {
  return uint32_t((uint64_t{hi} << 32 | lo) << (by & 31) >> 32);
}
inline uint32_t __funnelshift_r(uint32_t lo, uint32_t hi, uint32_t by) {
  return uint32_t((uint64_t{hi} << 32 | lo) >> (by & 31));
}
inline uint32_t __umulhi(uint32_t a, uint32_t b) {
  return uint32_t(uint64_t{a} * b >> 32);
}
inline int __float_as_int(float v) {
  return std::bit_cast<int>(v);
}
inline uint32_t __float_as_uint(float v) {
  return std::bit_cast<uint32_t>(v);
}
inline float __int_as_float(int v) {
  return std::bit_cast<float>(v);
}
inline float __uint_as_float(uint32_t v) {
  return std::bit_cast<float>(v);
}
inline double __longlong_as_double(long long v) {
  return std::bit_cast<double>(v);
}
inline long long __double_as_longlong(double v) {
  return std::bit_cast<long long>(v);
}

template <typename T>
T __ldg(const T* p) {
  return *p;
}
template <typename T>
T __ldcs(const T* p) {
  return *p;
}
// In builds that look for races, accesses that may be concurrent are reported by explicit calls instead of by
// instrumentation.
#ifdef CUDA_EMULATOR_RACES
#define CUDA_EMULATOR_TELLS __attribute__((noinline, no_sanitize("thread")))
#else
#define CUDA_EMULATOR_TELLS inline
#endif
template <typename T>
CUDA_EMULATOR_TELLS T __ldcg(const T* p) {
  cuda_emulator::races::Relaxed(p, sizeof *p, false, __builtin_return_address(0));
  return *p;
}
template <typename T>
CUDA_EMULATOR_TELLS T __ldca(const T* p) {
  cuda_emulator::races::Relaxed(p, sizeof *p, false, __builtin_return_address(0));
  return *p;
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS void __stcg(T* p, U value) {
  cuda_emulator::races::Relaxed(p, sizeof *p, true, __builtin_return_address(0));
  *p = value;
}
template <typename T>
CUDA_EMULATOR_TELLS T __ldcv(const T* p) {
  cuda_emulator::races::Relaxed(p, sizeof *p, false, __builtin_return_address(0));
  return *p;
}
template <typename T, typename U>
void __stcs(T* p, U value) {
  *p = value;
}

namespace cuda_emulator {
// What is there becomes what `change` makes of it, told of as done by `where`. Fibers give way only at rendezvous, so
// atomics need no more.
template <typename T, typename Change>
CUDA_EMULATOR_TELLS T Modify(T* p, const void* where, const Change& change) {
  races::Relaxed(p, sizeof *p, true, where);
  const T before = *p;
  *p = change(before);
  return before;
}
}  // namespace cuda_emulator
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicAdd(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of + T(v)); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicSub(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of - T(v)); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicMin(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(T(v) < of ? T(v) : of); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicMax(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of < T(v) ? T(v) : of); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicAnd(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of & T(v)); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicOr(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of | T(v)); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicXor(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T of) { return T(of ^ T(v)); });
}
template <typename T, typename U>
CUDA_EMULATOR_TELLS T atomicExch(T* p, U v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0), [v](T) { return T(v); });
}
template <typename T, typename U, typename V>
CUDA_EMULATOR_TELLS T atomicCAS(T* p, U expected, V v) {
  return cuda_emulator::Modify(p, __builtin_return_address(0),
                               [expected, v](T of) { return of == T(expected) ? T(v) : of; });
}

template <typename A, typename B>
constexpr std::common_type_t<A, B> min(A a, B b) {
  using T = std::common_type_t<A, B>;
  return T(b) < T(a) ? T(b) : T(a);
}
template <typename A, typename B>
constexpr std::common_type_t<A, B> max(A a, B b) {
  using T = std::common_type_t<A, B>;
  return T(a) < T(b) ? T(b) : T(a);
}
