// What an error about a limit knows in numbers, so that callers need not read its text.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "base/vec.h"

namespace voxelpipe {

struct LimitError {
  uint64_t need_bytes = 0;  // 0 where it is more than can be counted
  uint64_t limit_bytes = 0;
  // What would fit of the same request, in the terms in which it asked for its grid; 0 where it asked in others, or
  // nothing would fit.
  int64_t largest_resolution = 0;
  Vec3d smallest_voxel_size{};  // of requests with a voxel size, dims given or not
};

// A number with as many digits as give it back exactly, and no more.
std::string ExactText(double number);

// RESOURCE_EXHAUSTED with this text, from which LimitErrorOf gets the numbers back. They are lost where somebody makes
// a new status out of code and message.
absl::Status MakeLimitError(std::string_view message, const LimitError& numbers);
// The numbers of a MakeLimitError, in this process or come from a server; nothing for all other statuses.
std::optional<LimitError> LimitErrorOf(const absl::Status& status);

// The same error of a request that would fit alone: others use what it needs now, so that it may come again.
absl::Status MarkInUseByOthers(absl::Status status);
bool IsInUseByOthers(const absl::Status& status);

// The same error, with all that it knows, and another text.
absl::Status WithText(const absl::Status& status, std::string_view text);

}  // namespace voxelpipe
