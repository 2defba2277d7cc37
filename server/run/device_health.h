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
  kQuarantined,  // gets no work; it is probed from time to time
  kProbing,      // a probe runs
};

struct DeviceHealthOptions {
  std::chrono::milliseconds probe_interval{
      1000};  // from the quarantine to the first probe; doubled after each that fails
  std::chrono::milliseconds max_probe_interval{60'000};  // at most
};

// Serving at first. Not thread-safe. Times are the caller's: any steady clock, never going back.
class DeviceHealth {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit DeviceHealth(const DeviceHealthOptions& options) : options_(options), interval_(options.probe_interval) {}

  DeviceState state() const { return state_; }
  bool serving() const { return state_ == DeviceState::kServing; }
  const std::string& reason() const { return reason_; }  // of the quarantine; empty while it serves
  Time since() const { return since_; }                  // of the state, leaving probes out
  // When a probe is due; nothing while the device serves or is being probed.
  std::optional<Time> next_probe() const;

  // A run ended well.
  void Succeeded() { errors_ = 0; }
  // A run failed because of the device: kLost quarantines at once, kError where the run before failed, too;
  // kOutOfMemory never does. True where the device was serving and is not any more.
  bool Failed(DeviceFailureKind kind, std::string_view reason, Time now);
  // True where a probe is due: the caller makes it and calls Probed.
  bool BeginProbe(Time now);
  // The end of a probe; OK puts the device back to work. True where it serves now.
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
