#include "base/device_failure.h"

#include "absl/strings/cord.h"

namespace voxelpipe {
namespace {

constexpr char kUrl[] = "voxelpipe/device_failure";

const char* Mark(DeviceFailureKind kind) {
  switch (kind) {
    case DeviceFailureKind::kError: return "error";
    case DeviceFailureKind::kLost: return "lost";
    case DeviceFailureKind::kOutOfMemory: return "memory";
  }
  return "error";
}

}  // namespace

absl::Status MarkDeviceFailure(absl::Status status, DeviceFailureKind kind) {
  status.SetPayload(kUrl, absl::Cord(Mark(kind)));
  return status;
}

std::optional<DeviceFailureKind> DeviceFailureOf(const absl::Status& status) {
  const auto mark = status.GetPayload(kUrl);
  if (!mark) return std::nullopt;
  for (const auto kind : {DeviceFailureKind::kError, DeviceFailureKind::kLost, DeviceFailureKind::kOutOfMemory}) {
    if (*mark == Mark(kind)) return kind;
  }
  return std::nullopt;
}

}  // namespace voxelpipe
