// The access log: one line a call, written when the call is over.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace voxelpipe {

struct CallRecord {
  CallRecord(uint64_t request_id, const char* called_method, std::string client_address)
      : id(request_id), method(called_method), peer(std::move(client_address)) {}

  // key=value pairs: request, method, peer, code, ms, bytes in and out, what else is known, and the message of an error.
  void Log(const absl::Status& status) const;

  const uint64_t id;
  const char* const method;
  const std::string peer;
  const std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  uint64_t bytes_in = 0, bytes_out = 0;
  std::string facts;  // more pairs, each with a leading space
};

}  // namespace voxelpipe
