#include "run/device_health.h"

#include <algorithm>

namespace voxelpipe {
namespace {

// One error may be chance; two in a row are a fault of the device.
constexpr int kErrorsInARow = 2;

}  // namespace

std::optional<DeviceHealth::Time> DeviceHealth::next_probe() const {
  if (state_ != DeviceState::kQuarantined) return std::nullopt;
  return next_probe_;
}

bool DeviceHealth::Failed(DeviceFailureKind kind, std::string_view reason, Time now) {
  if (kind == DeviceFailureKind::kOutOfMemory || !serving()) return false;
  ++errors_;
  if (kind == DeviceFailureKind::kError && errors_ < kErrorsInARow) return false;
  // The probe interval of a device that recovers and soon fails again is not reset.
  if (now - since_ > options_.max_probe_interval) interval_ = options_.probe_interval;
  Quarantine(reason, now);
  since_ = now;
  return true;
}

void DeviceHealth::Quarantine(std::string_view reason, Time now) {
  state_ = DeviceState::kQuarantined;
  reason_ = std::string(reason);
  next_probe_ = now + interval_;
  interval_ = std::min(2 * interval_, options_.max_probe_interval);
}

bool DeviceHealth::BeginProbe(Time now) {
  if (state_ != DeviceState::kQuarantined || now < next_probe_) return false;
  state_ = DeviceState::kProbing;
  return true;
}

bool DeviceHealth::Probed(const absl::Status& outcome, Time now) {
  if (state_ != DeviceState::kProbing) return serving();
  if (!outcome.ok()) {
    Quarantine({outcome.message().data(), outcome.message().size()}, now);
    return false;
  }
  state_ = DeviceState::kServing;
  reason_.clear();
  errors_ = 0;
  since_ = now;
  return true;
}

}  // namespace voxelpipe
