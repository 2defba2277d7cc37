// Marks a status as a failure of the device and not of the request.
#pragma once

#include <optional>

#include "absl/status/status.h"

namespace voxelpipe {

enum class DeviceFailureKind {
  kError,        // something went wrong once; the device may well do the next run
  kLost,         // every further call is expected to fail, until the device passes a probe
  kOutOfMemory,  // of the device: less at the same time may fit
};

// `status`, which must not be OK, with the mark; code, message and other payloads stay. The mark is lost where somebody
// makes a new status out of code and message. Where there is a mark already, the new one takes its place.
absl::Status MarkDeviceFailure(absl::Status status, DeviceFailureKind kind);
// The mark; nothing where the request or the caller is at fault, for OK too.
std::optional<DeviceFailureKind> DeviceFailureOf(const absl::Status& status);

}  // namespace voxelpipe
