#include "base/memory_budget.h"

#include <cassert>
#include <limits>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "base/limit_error.h"

namespace voxelpipe {
namespace {

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

}  // namespace

MemoryBudget::~MemoryBudget() { assert(used_bytes() == 0); }

absl::Status MemoryBudget::Take(uint64_t bytes, std::string_view what) {
  uint64_t used = used_.load(std::memory_order_relaxed);
  uint64_t sum = 0;
  do {
    const std::optional<uint64_t> checked = CheckedAdd(used, bytes);
    if (!checked || *checked > limit_) {
      const uint64_t need = checked.value_or(std::numeric_limits<uint64_t>::max());
      return MakeLimitError(absl::StrCat(View(what), " needs ", bytes, " bytes of memory beside ", used,
                                         " in use; the limit is ", limit_, " bytes"),
                            {need, limit_, 0});
    }
    sum = *checked;
  } while (!used_.compare_exchange_weak(used, sum, std::memory_order_relaxed));
  if (parent_ != nullptr) {
    if (absl::Status full = parent_->Take(bytes, what); !full.ok()) {
      used_.fetch_sub(bytes, std::memory_order_relaxed);
      return full;
    }
  }
  uint64_t peak = peak_bytes();
  while (peak < sum && !peak_.compare_exchange_weak(peak, sum, std::memory_order_relaxed)) {
  }
  return absl::OkStatus();
}

void MemoryBudget::Give(uint64_t bytes) {
  used_.fetch_sub(bytes, std::memory_order_relaxed);
  if (parent_ != nullptr) parent_->Give(bytes);
}

absl::Status MemoryCharge::Grow(uint64_t bytes, std::string_view what) {
  if (budget_ == nullptr) return absl::OkStatus();
  if (absl::Status full = budget_->Take(bytes, what); !full.ok()) return full;
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
