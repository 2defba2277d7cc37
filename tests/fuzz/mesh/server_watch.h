// A server process under a fuzzer: its state and its memory.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace voxelpipe::fuzz {

// Thread-safe, but for Start and the destructor.
class ServerWatch {
 public:
  // Starts `program`, a voxelpiped, on a free port of the loopback, and waits until it serves. Its log goes to
  // `log_path`.
  static absl::StatusOr<std::unique_ptr<ServerWatch>> Start(const std::string& program,
                                                            std::vector<std::string> arguments,
                                                            const std::string& log_path);
  ~ServerWatch();
  ServerWatch(const ServerWatch&) = delete;
  ServerWatch& operator=(const ServerWatch&) = delete;

  const std::string& address() const { return address_; }
  // Empty while it runs; otherwise how it ended: "signal 11", "exit code 1".
  std::string Ended();
  // Resident memory of it and of its children, bytes.
  uint64_t ResidentBytes() const;

 private:
  ServerWatch() = default;

  pid_t pid_ = -1;
  int output_ = -1;
  std::string address_, ended_;
};

}  // namespace voxelpipe::fuzz
