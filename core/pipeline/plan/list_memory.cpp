#include "pipeline/plan/list_memory.h"

#include <algorithm>

#include "pipeline/plan/list_refusal.h"

namespace voxelpipe {
namespace {

constexpr char kBeyondPlan[] = "voxelpipe/beyond-plan";  // a status payload's type

}  // namespace

absl::Status RefuseBeyondPlan() {
  absl::Status status = absl::ResourceExhaustedError("the run needs more memory than the limit allows");
  status.SetPayload(kBeyondPlan, absl::Cord());
  return status;
}

bool IsRefusedBeyondPlan(const absl::Status& status) {
  return status.GetPayload(kBeyondPlan).has_value();
}

absl::Status ListMemory::Need(uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  const uint64_t all = held_ + bytes, granted = std::max(granted_, planned_);
  if (all <= granted) return absl::OkStatus();
  if (all - planned_ > room_) {
    refused_ = std::max(refused_, all - planned_);
    return RefuseBeyondPlan();
  }
  if (absl::Status full = charge_.Grow(all - granted, "what the mesh touches of the grid"); !full.ok()) return full;
  granted_ = all;
  return absl::OkStatus();
}

void ListMemory::Hold(uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  held_ += bytes;
}

uint64_t ListMemory::refused_bytes() const {
  const std::lock_guard lock(mutex_);
  return refused_;
}

void ListCount::Ask(uint64_t bytes) {
  absl::Status refused = memory_->Need(bytes);
  if (refused.ok()) return;
  const std::lock_guard lock(mutex_);
  if (status_.ok()) status_ = std::move(refused);
  stop_.store(true, std::memory_order_relaxed);
}

}  // namespace voxelpipe
