// What a request says about how it is to be served. None of it changes the result's bytes.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

namespace voxelpipe {

enum class Priority : uint8_t { kHigh, kNormal, kLow };
enum class Compression : uint8_t { kNone, kZstd };  // of the pieces of a result on their way

struct CallSettings {
  Compression compression = Compression::kNone;
  Priority priority = Priority::kNormal;
  std::optional<bool> fallback;  // may another kind of backend run it; absent: the server's choice
  std::optional<std::chrono::milliseconds> queue_timeout;  // wait for a worker; absent: the server's default
  // True if the summary carries the SHA-256 of the whole result. The CRC-32C of every piece is there in any case, at a
  // tenth of the cost.
  bool content_hash = true;
};

}  // namespace voxelpipe
