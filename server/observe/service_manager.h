// The service manager that started this process, systemd for instance, and what it wants to know: readiness, the end,
// signs of life.
#pragma once

#include <chrono>
#include <string>
#include <utility>

#include "absl/status/status.h"

namespace voxelpipe {

// Source: systemd, sd_notify(3) and sd_watchdog_enabled(3). The protocol is one datagram a message, is declared stable,
// and may be implemented without libsystemd, which would load five more libraries (compression, cryptography) into the
// server and every process that loads meshes.
class ServiceManager {
 public:
  // The one that the environment names: NOTIFY_SOCKET, WATCHDOG_USEC, and WATCHDOG_PID if it is not this process's.
  // Without these variables there is none.
  static ServiceManager OfEnvironment();

  // In: "/PATH" or "@NAME" of a socket, empty for none; the time without a sign of life after which the service manager
  // takes the process for stuck, 0 for never.
  ServiceManager(std::string socket, std::chrono::microseconds watchdog)
      : socket_(std::move(socket)), watchdog_(watchdog) {}

  // How often to call Alive(): half of the watchdog's time; 0: not at all.
  std::chrono::milliseconds alive_interval() const;

  // Each sends one message, or nothing if there is no service manager. Errors: those of the socket. Waits at most 5 s
  // for a service manager that does not read.
  absl::Status Ready(const std::string& status) const;  // serves; `status`: one line for people
  // Ends, and takes at most `longest` for it, whatever the service manager's own limit is.
  absl::Status Stopping(std::chrono::milliseconds longest) const;
  absl::Status Alive() const;

 private:
  absl::Status Send(const std::string& message) const;

  const std::string socket_;
  const std::chrono::microseconds watchdog_;
};

}  // namespace voxelpipe
