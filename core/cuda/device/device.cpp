// Enumerates devices, lends their streams to runs, recovers lost devices, and accounts for device memory.
#include "cuda/device/device.h"

#include <cuda_runtime_api.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <mutex>
#include <optional>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "cuda/device/buffer.h"
#include "cuda/device/check.h"
#include "cuda/device/graph_cache.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/device/pinned.h"
#include "cuda/device/run_memory.h"

namespace voxelpipe::cuda {
namespace {

// Keeps freed memory in the pool: with the default threshold every synchronization returns it to the driver.
absl::Status KeepPool(int ordinal) {
  cudaMemPool_t pool;
  VOXELPIPE_CUDA_OR_RETURN(cudaDeviceGetDefaultMemPool(&pool, ordinal));
  uint64_t keep = UINT64_MAX;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep));
  return absl::OkStatus();
}

absl::StatusOr<DeviceInfo> Describe(int ordinal) {
  DeviceInfo info;
  info.ordinal = ordinal;
  cudaDeviceProp properties;
  VOXELPIPE_CUDA_OR_RETURN(cudaSetDevice(ordinal));
  VOXELPIPE_CUDA_OR_RETURN(cudaGetDeviceProperties(&properties, ordinal));
  info.name = properties.name;
  info.multiprocessors = properties.multiProcessorCount;
  info.shared_bytes_per_block = properties.sharedMemPerBlockOptin;
  info.memory_bytes = properties.totalGlobalMem;
  VOXELPIPE_OK_OR_RETURN(KeepPool(ordinal));
  return info;
}

// State of a device at run time.
struct Slot {
  std::mutex mutex;
  std::string lost;                      // the reason; empty: not lost
  int runs = 0;                          // runs that use the device
  std::vector<cudaStream_t> streams[2];  // idle streams, indexed by Turn
};

struct Found {
  std::vector<DeviceInfo> devices;
  std::deque<Slot> slots;  // by ordinal, one for each device that the driver counts
  absl::Status why_none;
};

// True while Find() runs: there are no slots yet, and failures go to why_none.
thread_local bool finding = false;

Found* Find() {
  finding = true;
  const absl::Cleanup done = [] { finding = false; };
  auto* const found = new Found;
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess || count == 0) {
    (void)cudaGetLastError();
    found->why_none = absl::FailedPreconditionError(absl::StrCat(
        "backend: no CUDA device (", error == cudaSuccess ? "the driver lists none" : cudaGetErrorString(error), ")"));
    return found;
  }
  for (int i = 0; i < count; ++i) {
    found->slots.emplace_back();
    absl::StatusOr<DeviceInfo> device = Describe(i);
    if (device.ok()) {
      found->devices.push_back(*std::move(device));
    } else if (found->why_none.ok()) {
      found->why_none = absl::FailedPreconditionError(
          absl::StrCat("backend: no CUDA device answers: ", std::string(device.status().message())));
    }
  }
  if (!found->devices.empty()) (void)cudaSetDevice(found->devices[0].ordinal);
  return found;
}

Found& TheFound() {
  static Found* const found = Find();  // never destroyed: results may outlive static objects
  return *found;
}

Slot* SlotOf(int ordinal) {
  if (finding) return nullptr;
  Found& found = TheFound();
  return ordinal >= 0 && size_t(ordinal) < found.slots.size() ? &found.slots[size_t(ordinal)] : nullptr;
}

absl::Status LostStatus(const std::string& why) {
  return MarkDeviceFailure(absl::FailedPreconditionError(absl::StrCat("backend: the CUDA device was lost: ", why)),
                           DeviceFailureKind::kLost);
}

thread_local uint64_t launches_of_thread = 0;

bool IsSticky(cudaError_t error) {
  switch (error) {
    case cudaErrorIllegalAddress:
    case cudaErrorLaunchFailure:
    case cudaErrorHardwareStackError:
    case cudaErrorIllegalInstruction:
    case cudaErrorMisalignedAddress:
    case cudaErrorInvalidAddressSpace:
    case cudaErrorInvalidPc:
    case cudaErrorAssert:
    case cudaErrorECCUncorrectable:
    case cudaErrorLaunchTimeout: return true;
    default: return false;
  }
}

struct Memory {
  uint64_t free = 0, idle = 0,
           all = 0;  // bytes free in the driver, idle in the pool (the driver counts them as used), and in total
};

// Memory of the current device; nullopt if it cannot be determined.
std::optional<Memory> MemoryNow() {
  size_t free = 0, all = 0;
  if (cudaMemGetInfo(&free, &all) != cudaSuccess) {
    (void)cudaGetLastError();
    return std::nullopt;
  }
  int ordinal = 0;
  cudaMemPool_t pool = nullptr;
  uint64_t reserved = 0, used = 0;
  const bool pooled = cudaGetDevice(&ordinal) == cudaSuccess &&
                      cudaDeviceGetDefaultMemPool(&pool, ordinal) == cudaSuccess &&
                      cudaMemPoolGetAttribute(pool, cudaMemPoolAttrReservedMemCurrent, &reserved) == cudaSuccess &&
                      cudaMemPoolGetAttribute(pool, cudaMemPoolAttrUsedMemCurrent, &used) == cudaSuccess;
  if (!pooled) (void)cudaGetLastError();  // clears the error, which is not the caller's
  return Memory{free, pooled && reserved > used ? reserved - used : 0, all};
}

// Free memory of the current device as text; empty if it cannot be determined.
std::string MemoryAtHand() {
  const std::optional<Memory> memory = MemoryNow();
  if (!memory) return "";
  return absl::StrCat(memory->free + memory->idle, " of ", memory->all, " bytes of device memory are free, ",
                      memory->idle, " of them in the pool");
}

std::atomic<uint64_t> limit_bytes{UINT64_MAX}, taken_bytes{0}, peak_bytes{0};  // see LimitMemory
std::atomic<uint64_t> assumed_cache{0};

// Resets a lost device: all its allocations are gone. No run uses it.
absl::Status Reset(int ordinal, Slot& slot) {
  DropCachedMeshes(ordinal);
  ForgetPinned();
  for (auto& streams : slot.streams) streams.clear();  // the reset destroys them
  VOXELPIPE_CUDA_OR_RETURN(cudaSetDevice(ordinal));
  DropLaunchGraphs(ordinal);
  (void)cudaDeviceReset();  // returns the error that lost the device once more
  (void)cudaGetLastError();
  return KeepPool(ordinal);
}

}  // namespace

absl::StatusOr<const std::vector<DeviceInfo>*> AllDevices() {
  const Found& found = TheFound();
  if (found.devices.empty()) return found.why_none;
  return &found.devices;
}

absl::Status CheckDevice(int ordinal) {
  Slot* const slot = SlotOf(ordinal);
  if (slot == nullptr) return absl::FailedPreconditionError("backend: there is no such CUDA device");
  const std::lock_guard lock(slot->mutex);
  return slot->lost.empty() ? absl::OkStatus() : LostStatus(slot->lost);
}

void MarkDeviceLost(int ordinal, std::string_view reason) {
  Slot* const slot = SlotOf(ordinal);
  if (slot == nullptr) return;
  const std::lock_guard lock(slot->mutex);
  if (slot->lost.empty()) slot->lost = std::string(reason);
}

absl::StatusOr<DeviceUse> DeviceUse::Begin(int ordinal, Turn turn) {
  Slot* const slot = SlotOf(ordinal);
  if (slot == nullptr) return absl::FailedPreconditionError("backend: there is no such CUDA device");
  cudaStream_t stream = nullptr;
  {
    const std::lock_guard lock(slot->mutex);
    if (!slot->lost.empty()) return LostStatus(slot->lost);
    ++slot->runs;
    auto& idle = slot->streams[int(turn)];
    if (!idle.empty()) {
      stream = idle.back();
      idle.pop_back();
    }
  }
  DeviceUse use(ordinal, turn, stream);
  VOXELPIPE_CUDA_OR_RETURN(cudaSetDevice(ordinal));
  if (stream != nullptr) return use;
  int last = 0, first = 0;  // lowest priority (largest number), highest priority
  VOXELPIPE_CUDA_OR_RETURN(cudaDeviceGetStreamPriorityRange(&last, &first));
  VOXELPIPE_CUDA_OR_RETURN(
      cudaStreamCreateWithPriority(&use.stream_, cudaStreamNonBlocking, turn == Turn::kFirst ? first : last));
  return use;
}

absl::Status DeviceUse::After(cudaStream_t earlier) const {
  cudaEvent_t done = nullptr;
  VOXELPIPE_CUDA_OR_RETURN(cudaEventCreateWithFlags(&done, cudaEventDisableTiming));
  cudaError_t error = cudaEventRecord(done, earlier);
  if (error == cudaSuccess) error = cudaStreamWaitEvent(stream_, done, 0);
  (void)cudaEventDestroy(done);  // destroyed when it completes
  VOXELPIPE_CUDA_OR_RETURN(error);
  return absl::OkStatus();
}

void DeviceUse::Wait() const {
  if (const cudaError_t error = cudaStreamSynchronize(stream_); error != cudaSuccess) {
    (void)cudaGetLastError();
    if (IsSticky(error)) MarkDeviceLost(ordinal_, absl::StrCat("CUDA: ", cudaGetErrorString(error)));
  }
}

DeviceUse::~DeviceUse() {
  if (ordinal_ < 0) return;
  Wait();
  Slot& slot = *SlotOf(ordinal_);
  const std::lock_guard lock(slot.mutex);
  --slot.runs;
  if (slot.lost.empty() && stream_ != nullptr) slot.streams[int(turn_)].push_back(stream_);
}

absl::Status ProbeDevice(int ordinal) {
  Slot* const slot = SlotOf(ordinal);
  if (slot == nullptr) return absl::FailedPreconditionError("backend: there is no such CUDA device");
  std::unique_lock lock(slot->mutex);
  if (slot->lost.empty()) {
    lock.unlock();
    absl::StatusOr<DeviceUse> use = DeviceUse::Begin(ordinal);
    return use.ok() ? RunProbe(use->stream()) : use.status();
  }
  // No run starts on a lost device, so the lock is not needed for this one; it makes other probes wait.
  if (slot->runs > 0) return LostStatus(absl::StrCat(slot->lost, "; ", slot->runs, " of its runs have not ended yet"));
  const std::string why = std::exchange(slot->lost, "it is being reset");
  ++slot->runs;
  lock.unlock();
  absl::Status status = Reset(ordinal, *slot);
  if (status.ok()) status = RunProbe(nullptr);
  lock.lock();
  --slot->runs;
  slot->lost = status.ok() ? "" : why;
  if (status.ok()) return status;
  return LostStatus(absl::StrCat(
      why, "; it does not come back to this process, another one may have it: ", std::string(status.message())));
}

uint64_t FreeMemory(int ordinal) {
  if (cudaSetDevice(ordinal) != cudaSuccess) (void)cudaGetLastError();
  const std::optional<Memory> memory = MemoryNow();
  const uint64_t limit = limit_bytes, taken = taken_bytes;
  return std::min(memory ? memory->free + memory->idle : 0, limit > taken ? limit - taken : 0);
}

void TrimMemory(int ordinal) {
  DropCachedMeshes(ordinal);
  DropLaunchGraphs(ordinal);
  cudaMemPool_t pool = nullptr;
  if (cudaDeviceGetDefaultMemPool(&pool, ordinal) != cudaSuccess || cudaMemPoolTrimTo(pool, 0) != cudaSuccess) {
    (void)cudaGetLastError();  // the pool stays as large as before
  }
}

void LimitMemory(uint64_t bytes) {
  limit_bytes = bytes;
}
uint64_t MemoryLimit() {
  return limit_bytes;
}

void AssumeCache(uint64_t bytes) {
  assumed_cache = bytes;
}
uint64_t AssumedCache() {
  return assumed_cache;
}

uint64_t MemoryTaken() {
  return taken_bytes;
}

uint64_t MemoryPeak() {
  return peak_bytes;
}

void ResetMemoryPeak() {
  peak_bytes = taken_bytes.load();
}

bool TakeMemory(uint64_t bytes) {
  RunMemory* const run = RunMemory::OfThread();
  if (run != nullptr && !run->Take(bytes)) return false;
  const uint64_t before = taken_bytes.fetch_add(bytes, std::memory_order_relaxed);
  const uint64_t limit = limit_bytes.load(std::memory_order_relaxed);
  if (bytes <= limit && before <= limit - bytes) {
    uint64_t most = peak_bytes.load(std::memory_order_relaxed);
    while (most < before + bytes && !peak_bytes.compare_exchange_weak(most, before + bytes)) {}
    return true;
  }
  ReturnMemory(bytes);
  return false;
}

void ReturnMemory(uint64_t bytes) {
  if (RunMemory* const run = RunMemory::OfThread(); run != nullptr) run->Return(bytes);
  taken_bytes.fetch_sub(bytes, std::memory_order_relaxed);
}

absl::Status LimitStatus(uint64_t bytes) {
  if (const RunMemory* const run = RunMemory::OfThread(); run != nullptr && !run->refusal().ok()) return run->refusal();
  const uint64_t limit = limit_bytes, taken = taken_bytes;
  return MarkDeviceFailure(absl::ResourceExhaustedError(absl::StrCat(
                               bytes, " bytes of device memory needed: ", limit > taken ? limit - taken : 0, " of ",
                               limit, " bytes are free")),
                           DeviceFailureKind::kOutOfMemory);
}

uint64_t LaunchesOfThread() {
  return launches_of_thread;
}
void CountLaunch() {
  ++launches_of_thread;
}

absl::Status NeedStatus(const absl::Status& status, uint64_t bytes) {
  const absl::Status told(status.code(),
                          absl::StrCat(bytes, " bytes of device memory needed: ", std::string(status.message())));
  const auto mark = DeviceFailureOf(status);
  return mark ? MarkDeviceFailure(told, *mark) : told;
}

absl::Status CudaStatus(cudaError_t error, const char* expression, const char* file, int line) {
  if (error == cudaSuccess) return absl::OkStatus();
  (void)cudaGetLastError();  // clears the error, so that the next call does not return it again
  const std::string_view path(file);
  const std::string message = absl::StrCat(
      "CUDA: ", cudaGetErrorString(error), " in ", expression, " (",
      std::string(path.substr(path.rfind("core/") == path.npos ? 0 : path.rfind("core/"))), ":", line, ")");
  if (error == cudaErrorMemoryAllocation) {
    const std::string have = MemoryAtHand();
    return MarkDeviceFailure(absl::ResourceExhaustedError(have.empty() ? message : absl::StrCat(message, "; ", have)),
                             DeviceFailureKind::kOutOfMemory);
  }
  const bool lost = IsSticky(error);
  int ordinal = 0;
  if (lost && cudaGetDevice(&ordinal) == cudaSuccess) MarkDeviceLost(ordinal, message);
  return MarkDeviceFailure(absl::InternalError(message), lost ? DeviceFailureKind::kLost : DeviceFailureKind::kError);
}

}  // namespace voxelpipe::cuda
