// The settings of a request that do not change the bytes of its result.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

namespace voxelpipe {

enum class Priority : uint8_t { kHigh, kNormal, kLow };
enum class Compression : uint8_t { kNone, kZstd };  // of the pieces of a result

// The largest result that a server sends in one message.
inline constexpr int64_t kMaxSingleMessageBytes = 1 << 20;

struct CallSettings {
  Compression compression = Compression::kNone;
  Priority priority = Priority::kNormal;
  std::optional<bool> fallback;  // true: another kind of backend may run it; absent: the server's choice
  std::optional<std::chrono::milliseconds> queue_timeout;  // maximum wait for a worker; absent: the server's default
  // True if the summary carries the SHA-256 of the whole result. Every piece has a CRC-32C in any case, at a tenth of
  // the cost.
  bool content_hash = true;
  // A result of at most so many bytes comes in one message. Absent: the server's maximum, kMaxSingleMessageBytes.
  std::optional<int64_t> single_message_bytes;
};

}  // namespace voxelpipe
