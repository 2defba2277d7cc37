// Keeps the lists of a sparse or bucketed result back until they agree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "job/memory_sink.h"
#include "job/part_receiver.h"
#include "job/result.h"

namespace voxelpipe {

// Forwards a server's result to a sink that may use indices and offsets, such as a file that draws: the lists, which
// come first, and the table of parts, which comes last, are held in memory and forwarded when CheckLists and CheckParts
// accept them; all else is forwarded as it comes.
class CheckedLists final : public ResultSink {
 public:
  // `next` must outlive the object.
  explicit CheckedLists(ResultSink& next) : next_(next) {}

  // Also RESOURCE_EXHAUSTED if there is no memory for the lists.
  absl::Status Begin(const ResultHeader& header) override;
  // DATA_LOSS naming array and entry if the lists do not agree.
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;
  // After the last byte: forwards what is held. Errors as of Write; DATA_LOSS if the table of parts is inconsistent.
  absl::Status Finish();

 private:
  absl::Status ForwardLists();

  ResultSink& next_;
  ResultHeader header_;
  MemorySink held_;  // the lists
  bool forwarded_ = false;
  PartReceiver parts_;
};

}  // namespace voxelpipe
