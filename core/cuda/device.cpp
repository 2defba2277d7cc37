#include "cuda/device.h"

#include <cuda_runtime_api.h>

#include <mutex>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "cuda/check.h"

namespace voxelpipe::cuda {
namespace {

absl::StatusOr<DeviceInfo> Probe() {
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess || count == 0) {
    (void)cudaGetLastError();
    return absl::FailedPreconditionError(absl::StrCat(
        "backend: no CUDA device (", error == cudaSuccess ? "the driver lists none" : cudaGetErrorString(error), ")"));
  }
  DeviceInfo info;
  cudaDeviceProp properties;
  VOXELPIPE_CUDA_OR_RETURN(cudaSetDevice(info.ordinal));
  VOXELPIPE_CUDA_OR_RETURN(cudaGetDeviceProperties(&properties, info.ordinal));
  info.name = properties.name;
  info.multiprocessors = properties.multiProcessorCount;
  info.shared_bytes_per_block = properties.sharedMemPerBlockOptin;
  info.memory_bytes = properties.totalGlobalMem;
  // Freed memory stays in the pool: with the default threshold every synchronization gives it back to the driver.
  cudaMemPool_t pool;
  VOXELPIPE_CUDA_OR_RETURN(cudaDeviceGetDefaultMemPool(&pool, info.ordinal));
  uint64_t keep = UINT64_MAX;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep));
  return info;
}

thread_local uint64_t launches_of_thread = 0;

std::mutex lost_mutex;
std::string lost_reason;  // under lost_mutex; empty: not lost

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

// What the current device has left, in words; empty if that cannot be found out. What the pool keeps between runs can be
// had too, but the driver counts it as taken.
std::string MemoryAtHand() {
  size_t free = 0, all = 0;
  if (cudaMemGetInfo(&free, &all) != cudaSuccess) return "";
  int ordinal = 0;
  cudaMemPool_t pool = nullptr;
  uint64_t reserved = 0, used = 0;
  const bool pooled = cudaGetDevice(&ordinal) == cudaSuccess &&
                      cudaDeviceGetDefaultMemPool(&pool, ordinal) == cudaSuccess &&
                      cudaMemPoolGetAttribute(pool, cudaMemPoolAttrReservedMemCurrent, &reserved) == cudaSuccess &&
                      cudaMemPoolGetAttribute(pool, cudaMemPoolAttrUsedMemCurrent, &used) == cudaSuccess;
  if (!pooled) (void)cudaGetLastError();  // it is no error of the caller's
  const uint64_t idle = pooled && reserved > used ? reserved - used : 0;
  return absl::StrCat(free + idle, " of ", all, " bytes of device memory are free, ", idle, " of them in the pool");
}

}  // namespace

absl::StatusOr<DeviceInfo> TheDevice() {
  static const absl::StatusOr<DeviceInfo>* const probed = new absl::StatusOr<DeviceInfo>(Probe());
  if (!probed->ok()) return *probed;
  const std::lock_guard lock(lost_mutex);
  if (!lost_reason.empty()) {
    return MarkDeviceFailure(
        absl::FailedPreconditionError(absl::StrCat("backend: the CUDA device was lost: ", lost_reason)),
        DeviceFailureKind::kLost);
  }
  return *probed;
}

void MarkDeviceLost(std::string_view reason) {
  const std::lock_guard lock(lost_mutex);
  if (lost_reason.empty()) lost_reason = std::string(reason);
}

uint64_t LaunchesOfThread() {
  return launches_of_thread;
}
void CountLaunch() {
  ++launches_of_thread;
}

absl::Status CudaStatus(cudaError_t error, const char* expression, const char* file, int line) {
  if (error == cudaSuccess) return absl::OkStatus();
  (void)cudaGetLastError();  // so that the next call does not report it again
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
  if (lost) MarkDeviceLost(message);
  return MarkDeviceFailure(absl::InternalError(message), lost ? DeviceFailureKind::kLost : DeviceFailureKind::kError);
}

}  // namespace voxelpipe::cuda
