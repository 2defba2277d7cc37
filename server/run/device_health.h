// Health of a device: a state machine without a clock and without threads.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "base/device_failure.h"

namespace voxelpipe {

enum class DeviceState {
  kServing,
  kQuarantined,  // gets no work; probed periodically
  kProbing,      // a probe runs
};

struct DeviceHealthOptions {
  std::chrono::milliseconds probe_interval{
      1000};  // from the quarantine to the first probe; doubled after each failed probe
  std::chrono::milliseconds max_probe_interval{60'000};  // at most
};

// Serving at first. Not thread-safe. The caller passes times of a steady clock.
class DeviceHealth {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit DeviceHealth(const DeviceHealthOptions& options) : options_(options), interval_(options.probe_interval) {}

  DeviceState state() const { return state_; }
  bool serving() const { return state_ == DeviceState::kServing; }
  const std::string& reason() const { return reason_; }  // of the quarantine; empty while it serves
  Time since() const { return since_; }                  // of the state, ignoring probes
  // The time of the next probe; empty while the device serves or is being probed.
  std::optional<Time> next_probe() const;

  // A run succeeded.
  void Succeeded() { errors_ = 0; }
  // A run failed because of the device: kLost quarantines at once, kError if the previous run failed too; kOutOfMemory
  // never does. True if the device stopped serving.
  bool Failed(DeviceFailureKind kind, std::string_view reason, Time now);
  // True if a probe is due: the caller runs it and calls Probed.
  bool BeginProbe(Time now);
  // The end of a probe; OK returns the device to service. True if it serves now.
  bool Probed(const absl::Status& outcome, Time now);

 private:
  void Quarantine(std::string_view reason, Time now);

  const DeviceHealthOptions options_;
  DeviceState state_ = DeviceState::kServing;
  std::string reason_;
  Time since_{}, next_probe_{};
  std::chrono::milliseconds interval_;
  int errors_ = 0;  // in a row
};

}  // namespace voxelpipe
