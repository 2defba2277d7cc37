// Few colours for many.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/memory_budget.h"

namespace voxelpipe {

struct Palette {
  MemoryCharge memory;                             // of `nearest`
  std::vector<uint32_t> colours;                   // 0xRRGGBB
  absl::flat_hash_map<uint32_t, uint8_t> nearest;  // of each colour its place in `colours`
};

// In: colours 0xRRGGBB with how often each occurs; at most `size` colours are wanted, 1 to 256. Out: the colours
// themselves, ascending, if they are no more; otherwise those of the median cut: the box of colours with the largest
// product of occurrences and longest side is split at its weighted median until there are `size` boxes, and each box
// has the mean of its colours. The result does not depend on the order of the map. `job` may be null; its memory is
// charged for the call, and its errors are returned.
//
// Source: P. Heckbert, "Color Image Quantization for Frame Buffer Display", SIGGRAPH 1982. There a box is chosen by its
// occurrences alone.
absl::StatusOr<Palette> MakePalette(const absl::flat_hash_map<uint32_t, uint64_t>& occurrences, size_t size,
                                    const JobContext* job);

}  // namespace voxelpipe
