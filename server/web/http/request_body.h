// The body of a request, received into bounded memory.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "schedule/byte_budget.h"
#include "web/http/frames.h"

namespace voxelpipe {

// Not thread-safe.
class RequestBody {
 public:
  // `head_bytes` (0 or kFrameHeadBytes) of it are kept apart from the message; the message has at most `max_bytes`, and
  // its memory is charged to `budget` as it arrives. A body that sends less than 64 KiB in `idle` is idle.
  RequestBody(size_t head_bytes, uint64_t max_bytes, ByteBudget& budget, std::chrono::milliseconds idle);

  enum class Took { kGood, kIdle, kEndless };
  // Appends a piece, or drops it if the body is refused (status()). kIdle: the client is too slow. kEndless: more comes
  // than a refused body may send. The connection should be closed then.
  Took Append(std::string_view piece);

  // RESOURCE_EXHAUSTED if the message is too large, with RetryInfo if other uploads use the memory.
  const absl::Status& status() const { return status_; }
  const std::string& head() const { return head_; }
  uint64_t bytes() const { return bytes_; }  // of the whole body

  // The message, without a copy. Gives the budget back: whoever parses the message charges for it again.
  grpc::ByteBuffer Take();

 private:
  void Keep(std::string_view piece);
  void Refuse(absl::Status status);

  const size_t head_bytes_;
  const uint64_t max_bytes_;
  const std::chrono::milliseconds idle_;
  std::string head_;
  uint64_t bytes_ = 0;
  std::vector<std::string> blocks_;
  BudgetShare share_;
  absl::Status status_;
  std::chrono::steady_clock::time_point mark_ = std::chrono::steady_clock::now();
  uint64_t mark_bytes_ = 0;  // that had arrived at `mark_`
};

}  // namespace voxelpipe
