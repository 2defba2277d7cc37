// Marks a status as a failure of the device and not of the request.
#pragma once

#include <optional>

#include "absl/status/status.h"

namespace voxelpipe {

enum class DeviceFailureKind {
  kError,        // a single failure; the next run may succeed
  kLost,         // every further call is expected to fail, until the device passes a probe
  kOutOfMemory,  // of the device: a smaller load may fit
};

// `status`, which must not be OK, with the mark, which replaces an earlier one; code, message and other payloads stay.
// A new status made from code and message loses the mark.
absl::Status MarkDeviceFailure(absl::Status status, DeviceFailureKind kind);
// The mark; empty for OK and for errors of the request or the caller.
std::optional<DeviceFailureKind> DeviceFailureOf(const absl::Status& status);

}  // namespace voxelpipe
