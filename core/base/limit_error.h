// The numbers of an error about a limit, so that callers need not parse its text.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "base/vec.h"

namespace voxelpipe {

struct LimitError {
  uint64_t need_bytes = 0;  // 0 if it exceeds 64 bits
  uint64_t limit_bytes = 0;
  // The largest grid of this request that would fit, in the request's own terms; 0 if the request used other terms, or
  // if no grid would fit.
  int64_t largest_resolution = 0;
  Vec3d smallest_voxel_size{};  // of requests with a voxel size, dims given or not
};

// A number with the fewest digits that read back exactly.
std::string ExactText(double number);

// RESOURCE_EXHAUSTED with this text and a payload from which LimitErrorOf reads the numbers. A new status made from
// code and message loses them.
absl::Status MakeLimitError(std::string_view message, const LimitError& numbers);
// The numbers of a MakeLimitError of this process or of a server; empty for all other statuses.
std::optional<LimitError> LimitErrorOf(const absl::Status& status);

// The same error for a request that would fit alone: other requests use the memory now, so that it may be retried.
absl::Status MarkInUseByOthers(absl::Status status);
bool IsInUseByOthers(const absl::Status& status);

// The same error and payload with another text.
absl::Status WithText(const absl::Status& status, std::string_view text);

}  // namespace voxelpipe
