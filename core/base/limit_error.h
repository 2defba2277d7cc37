// What an error about a limit knows in numbers, so that callers need not read its text.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "absl/status/status.h"

namespace voxelpipe {

struct LimitError {
  uint64_t need_bytes = 0;
  uint64_t limit_bytes = 0;
  int64_t largest_resolution = 0;  // of the same request: what would fit; 0 if none does
};

// RESOURCE_EXHAUSTED with this text, from which LimitErrorOf gets the numbers back. They are lost where somebody makes a new
// status out of code and message.
absl::Status MakeLimitError(std::string_view message, const LimitError& numbers);
// The numbers of a MakeLimitError, in this process or come from a server; nothing for all other statuses.
std::optional<LimitError> LimitErrorOf(const absl::Status& status);

// The same error of a request that would fit alone: others use what it needs now, so that it may come again.
absl::Status MarkInUseByOthers(absl::Status status);
bool IsInUseByOthers(const absl::Status& status);

// The same error, with all that it knows, and another text.
absl::Status WithText(const absl::Status& status, std::string_view text);

}  // namespace voxelpipe
