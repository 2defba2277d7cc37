#include "base/memory_budget.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "base/limit_error.h"
#include "base/machine.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

absl::string_view View(std::string_view text) {
  return {text.data(), text.size()};
}

}  // namespace

MemoryBudget::~MemoryBudget() {
  assert(used_bytes() == 0);
}

absl::Status MemoryBudget::TakeBelow(uint64_t limit, uint64_t bytes, std::string_view what, bool may_wait) {
  uint64_t used = used_.load(std::memory_order_relaxed);
  uint64_t sum = 0;
  do {
    const std::optional<uint64_t> checked = CheckedAdd(used, bytes);
    if (!checked || *checked > limit) {
      // A product that overflowed arrives as UINT64_MAX, which is not printed.
      const bool counted = checked && bytes < std::numeric_limits<uint64_t>::max();
      const std::string need = counted ? BytesText(bytes) : "more than 2^63 bytes";
      return MakeLimitError(absl::StrCat(View(what), " needs ", need, " of memory beside ", BytesText(used),
                                         " in use; the limit is ", BytesText(limit)),
                            {.need_bytes = counted ? *checked : 0, .limit_bytes = limit});
    }
    sum = *checked;
  } while (!used_.compare_exchange_weak(used, sum, std::memory_order_relaxed));
  if (parent_ != nullptr) {
    const auto take = [&] { return parent_->TakeBelow(parent_limit_bytes(), bytes, what, true); };
    absl::Status full = take();
    while (!full.ok() && may_wait && wait_ && wait_(bytes)) full = take();
    if (!full.ok()) {
      used_.fetch_sub(bytes, std::memory_order_relaxed);
      return MarkInUseByOthers(std::move(full));
    }
  }
  held_.fetch_add(bytes, std::memory_order_relaxed);
  uint64_t peak = peak_bytes();
  while (peak < sum && !peak_.compare_exchange_weak(peak, sum, std::memory_order_relaxed)) {}
  return absl::OkStatus();
}

uint64_t MemoryBudget::parent_limit_bytes() const {
  const uint64_t limit = parent_->limit_bytes();
  // Not used_: it includes bytes that another thread of this request still waits for.
  const bool alone = parent_->used_bytes() <= held_bytes();
  return alone ? limit : limit - std::min(limit, leave_.load(std::memory_order_relaxed));
}

uint64_t MemoryBudget::available_bytes() const {
  const uint64_t limit = parent_limit_bytes();
  return limit - std::min(limit, parent_->used_bytes());
}

void MemoryBudget::Give(uint64_t bytes) {
  held_.fetch_sub(bytes, std::memory_order_relaxed);
  used_.fetch_sub(bytes, std::memory_order_relaxed);
  if (parent_ != nullptr) parent_->Give(bytes);
}

MemoryBudget& DefaultMemory() {
  // 0 if the system does not report it, as in a process that may no longer open files: then there is no limit.
  const auto half = [] {
    const uint64_t bytes = MemoryBytes();
    return bytes > 0 ? bytes / 2 : std::numeric_limits<uint64_t>::max();
  };
  static MemoryBudget& memory = *new MemoryBudget(half());  // never destroyed: static objects may still hold charges
  return memory;
}

absl::Status MemoryCharge::Grow(uint64_t bytes, std::string_view what) {
  if (budget_ == nullptr) return absl::OkStatus();
  if (absl::Status full = budget_->Take(bytes, what); !full.ok()) return full;
  bytes_ += bytes;
  return absl::OkStatus();
}

absl::Status MemoryCharge::GrowNow(uint64_t bytes, std::string_view what) {
  if (budget_ == nullptr) return absl::OkStatus();
  if (absl::Status full = budget_->TakeNow(bytes, what); !full.ok()) return full;
  bytes_ += bytes;
  return absl::OkStatus();
}

absl::Status MemoryCharge::Grow(uint64_t elements, uint64_t bytes_each, std::string_view what) {
  const std::optional<uint64_t> bytes = CheckedMul(elements, bytes_each);
  return Grow(bytes.value_or(std::numeric_limits<uint64_t>::max()), what);
}

void MemoryCharge::ShrinkTo(uint64_t bytes) {
  if (bytes >= bytes_) return;
  budget_->Give(bytes_ - bytes);
  bytes_ = bytes;
}

}  // namespace voxelpipe
