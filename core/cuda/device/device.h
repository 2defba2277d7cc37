// The CUDA devices that this process works on, who uses them, and which of them are lost.
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
  uint64_t shared_bytes_per_block = 0;  // with the opt-in
  uint64_t memory_bytes = 0;
};

// All devices, their memory pools set to keep what they have. Found once a process. FAILED_PRECONDITION saying why
// there is none: no driver, no device, or none that answers.
absl::StatusOr<const std::vector<DeviceInfo>*> AllDevices();

// OK unless the device was lost: then FAILED_PRECONDITION with the mark of base/device_failure.h.
absl::Status CheckDevice(int ordinal);

// Whose work a device takes first where streams have some at the same time. Streams of runs are of the device's highest
// priority, before a host application's own.
enum class Turn { kFirst, kBehind };

// A run's hold on a device: a stream, and the promise that nobody resets the device meanwhile. Movable. At the end it
// waits for the stream's work, which may still read or write memory of the run.
class DeviceUse {
 public:
  // Makes the device the calling thread's. Errors: CheckDevice's; INTERNAL.
  static absl::StatusOr<DeviceUse> Begin(int ordinal, Turn turn = Turn::kFirst);

  DeviceUse(DeviceUse&& other) noexcept
      : ordinal_(std::exchange(other.ordinal_, -1)),
        turn_(other.turn_),
        stream_(std::exchange(other.stream_, nullptr)) {}
  DeviceUse& operator=(DeviceUse&&) = delete;
  ~DeviceUse();

  cudaStream_t stream() const { return stream_; }
  // What the stream gets from now on waits for what `earlier` has got so far.
  absl::Status After(cudaStream_t earlier) const;
  void Wait() const;  // for the stream's work; errors come with the next call

 private:
  DeviceUse(int ordinal, Turn turn, cudaStream_t stream) : ordinal_(ordinal), turn_(turn), stream_(stream) {}

  int ordinal_;
  Turn turn_;
  cudaStream_t stream_;
};

// Called where an error leaves the device unusable until it is reset; CheckDevice fails from then on, naming `reason`.
void MarkDeviceLost(int ordinal, std::string_view reason);

// Whether the device works: allocates a little, runs a kernel on it and reads back what it wrote. A lost device is
// reset first, which takes until all its runs have ended; where it works again it is no longer lost. Many drivers (580
// is one) do not give a device back to a process that made it fail: then it stays lost until the process is started
// anew, and the status says so; and they take the process's other devices with it.
absl::Status ProbeDevice(int ordinal);

// Bytes that the device can still give out, what its pool keeps idle counted; 0 where that cannot be found out. Asks
// the driver.
uint64_t FreeMemory(int ordinal);
// Gives what the pool keeps idle back to the device, and forgets meshes and graphs of launches that no run holds. The
// stream's work must be done.
void TrimMemory(int ordinal);
// From now on arrays may take so many bytes of all devices together: for tests of what happens where there is less.
// UINT64_MAX: no limit.
void LimitMemory(uint64_t bytes);
uint64_t MemoryLimit();
uint64_t MemoryTaken();  // by arrays
// The most that arrays ever took since the last reset: for comparing runs with their plans.
uint64_t MemoryPeak();
void ResetMemoryPeak();
// From now on L2 caches are taken for ones of so many bytes, and meshes go the ways of those that keep the device busy:
// for tests of what happens in larger grids and with larger meshes. 0: caches and meshes are taken for what they are.
void AssumeCache(uint64_t bytes);
uint64_t AssumedCache();

// The probe's work on the current device (probe.cu). Synchronizes.
absl::Status RunProbe(cudaStream_t stream);

}  // namespace voxelpipe::cuda
