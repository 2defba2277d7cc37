// Accounting of a run's device and host memory, and the requests for more.
#include "cuda/device/run_memory.h"

#include "grid/page_pool.h"

namespace voxelpipe::cuda {

thread_local RunMemory* RunMemory::of_thread_ = nullptr;

RunMemory::~RunMemory() {
  RunMemory** at = &of_thread_;
  while (*at != nullptr && *at != this) at = &(*at)->before_;
  if (*at != nullptr) *at = before_;
}

absl::Status RunMemory::Ask() {
  const uint64_t bytes = taken_ + on_host_;
  if (lists_ == nullptr || bytes <= granted_) return absl::OkStatus();
  if (absl::Status s = lists_->Need(bytes); !s.ok()) return s;
  granted_ = bytes;
  return absl::OkStatus();
}

bool RunMemory::Take(uint64_t bytes) {
  taken_ += bytes;
  refusal_ = Ask();
  if (!refusal_.ok()) taken_ -= bytes;
  return refusal_.ok();
}

absl::Status RunMemory::TakeOnHost(uint64_t bytes) {
  constexpr uint64_t kHalfAPage = kPooledUnit / 2;                           // half of a block's last page
  on_host_ = bytes > kPooledBytes ? bytes + bytes / 8 + kHalfAPage : bytes;  // pinned blocks: four sizes per octave
  granted_ = 0;  // another slab is done, so more may be held since
  return Ask();
}

}  // namespace voxelpipe::cuda
