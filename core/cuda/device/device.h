// The CUDA devices of this process: enumeration, use by runs, loss and recovery, memory accounting.
#pragma once

#include <driver_types.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe::cuda {

struct DeviceInfo {
  int ordinal = 0;
  std::string name;
  int multiprocessors = 1;
  uint64_t shared_bytes_per_block = 0;  // including the opt-in limit
  uint64_t memory_bytes = 0;
};

// All devices, with memory pools that never shrink by themselves. Enumerated once per process. FAILED_PRECONDITION
// states why there is none: no driver, no device, or no device that responds.
absl::StatusOr<const std::vector<DeviceInfo>*> AllDevices();

// OK, or FAILED_PRECONDITION with the mark of base/device_failure.h if the device was lost.
absl::Status CheckDevice(int ordinal);

// Stream priority. Streams of runs (kFirst) have the device's highest priority, above a host application's own streams.
enum class Turn { kFirst, kBehind };

// Use of a device by a run: owns a stream and prevents a device reset. Movable. The destructor waits for the stream's
// work, which may still access the run's memory.
class DeviceUse {
 public:
  // Makes the device current for the calling thread. Errors: those of CheckDevice; INTERNAL.
  static absl::StatusOr<DeviceUse> Begin(int ordinal, Turn turn = Turn::kFirst);

  DeviceUse(DeviceUse&& other) noexcept
      : ordinal_(std::exchange(other.ordinal_, -1)),
        turn_(other.turn_),
        stream_(std::exchange(other.stream_, nullptr)) {}
  DeviceUse& operator=(DeviceUse&&) = delete;
  ~DeviceUse();

  cudaStream_t stream() const { return stream_; }
  // Work queued on the stream from now on waits for the work queued on `earlier` so far.
  absl::Status After(cudaStream_t earlier) const;
  void Wait() const;  // for the stream's work; the next call returns its errors

 private:
  DeviceUse(int ordinal, Turn turn, cudaStream_t stream) : ordinal_(ordinal), turn_(turn), stream_(stream) {}

  int ordinal_;
  Turn turn_;
  cudaStream_t stream_;
};

// Marks the device unusable until it is reset: CheckDevice fails from now on and names `reason`.
void MarkDeviceLost(int ordinal, std::string_view reason);

// Tests the device: allocates memory, runs a kernel and reads back its result. A lost device is reset first, after all
// its runs have ended; if it works again it is no longer lost. Many drivers (580 is one) refuse a device to the process
// that made it fail, and the process's other devices too: then it stays lost until the process restarts, and the status
// says so.
absl::Status ProbeDevice(int ordinal);

// Free bytes of the device, including idle memory of its pool; 0 if unknown. Calls the driver.
uint64_t FreeMemory(int ordinal);
// Returns the pool's idle memory to the device and drops cached meshes and launch graphs that no run uses. The stream's
// work must be done.
void TrimMemory(int ordinal);
// Limits the bytes of all device arrays of the process, to test low-memory behaviour. UINT64_MAX: no limit.
void LimitMemory(uint64_t bytes);
uint64_t MemoryLimit();
uint64_t MemoryTaken();  // by device arrays
// Peak of MemoryTaken() since the last reset, to compare runs with their plans.
uint64_t MemoryPeak();
void ResetMemoryPeak();
// Pretends that L2 caches have `bytes` bytes and that meshes are large enough to fill the device, to test the paths of
// larger grids and meshes. 0: real sizes.
void AssumeCache(uint64_t bytes);
uint64_t AssumedCache();

// The probe's work on the current device (probe.cu). Synchronizes.
absl::Status RunProbe(cudaStream_t stream);

}  // namespace voxelpipe::cuda
