// The messages of a finished job, made one at a time.
#pragma once

#include <cstdint>

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"

namespace voxelpipe {

// Not thread-safe.
class ReplyStream {
 public:
  virtual ~ReplyStream() = default;

  // The next message. Not after the last one, nor after an error.
  virtual grpc::ByteBuffer Next() = 0;
  // Why Next could not make a message: the call ends with it.
  virtual absl::Status status() const { return absl::OkStatus(); }
  // Work that can overlap with sending the message of Next. Call after each Next.
  virtual void CatchUp() {}
  virtual bool done() const = 0;
  // True if there is a next message and neither CatchUp nor Next have much work for it: it follows immediately.
  virtual bool next_is_ready() const = 0;

  virtual uint64_t bytes() const = 0;       // of the result, so far
  virtual uint64_t sent_bytes() const = 0;  // of the same, as sent
};

}  // namespace voxelpipe
