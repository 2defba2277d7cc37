// Keeps the lists of a sparse or bucketed result back until they agree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "job/memory_sink.h"
#include "job/result.h"

namespace voxelpipe {

// Forwards a server's result to a sink that may use indices and offsets, such as a file that draws: the lists, which
// come first, are held in memory and forwarded when CheckLists accepts them; all else is forwarded as it comes.
class CheckedLists final : public ResultSink {
 public:
  // `next` must outlive the object.
  explicit CheckedLists(ResultSink& next) : next_(next) {}

  // Also RESOURCE_EXHAUSTED if there is no memory for the lists.
  absl::Status Begin(const ResultHeader& header) override;
  // DATA_LOSS naming array and entry if the lists do not agree.
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;
  // After the last byte: a result without values has no later array. Errors as of Write.
  absl::Status Finish();

 private:
  ResultSink& next_;
  ResultHeader header_;
  size_t lists_ = 0;  // the first arrays
  MemorySink held_;
  bool forwarded_ = false;
};

}  // namespace voxelpipe
