// Lists that grow while a file is read, charged before they do.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "absl/status/status.h"
#include "base/memory_budget.h"

namespace voxelpipe {

// Room in a vector for `more` elements. One that grows does so to twice its size. Charged: all of its capacity and,
// while its elements move, that of the old one too. Errors: those of MemoryCharge::Grow.
template <typename List>
absl::Status MakeChargedRoom(MemoryCharge& charge, List& list, uint64_t more, std::string_view what) {
  if (list.capacity() - list.size() >= more) return absl::OkStatus();
  constexpr uint64_t kBytesEach = sizeof(typename List::value_type);
  const uint64_t grown = std::max<uint64_t>(list.size() + more, 2 * list.capacity());
  if (absl::Status full = charge.Grow(grown, kBytesEach, what); !full.ok()) return full;
  const uint64_t before = list.capacity() * kBytesEach;
  list.reserve(grown);
  charge.ShrinkTo(charge.bytes() - before);
  return absl::OkStatus();
}

}  // namespace voxelpipe
