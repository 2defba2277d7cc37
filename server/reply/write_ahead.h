// Chooses the messages of a stream that gRPC may buffer until the next one.
#pragma once

#include <utility>

#include <grpcpp/grpcpp.h>

namespace voxelpipe {

// The options of one call's writes, in their order. Not thread-safe.
//
// A write with the buffer hint completes as soon as gRPC has it, and its bytes are sent with those of a later write, so
// that several share a packet. Never for the first write of a call: it carries the headers and completes only when they
// are sent, which the hint delays too. The call would wait for that write, and the write for the next one, until
// something else is sent on the connection.
class WriteAhead {
 public:
  // The options of the next write. `more_follows`: after it the call writes or finishes immediately in all cases, and
  // waits for no other write before.
  grpc::WriteOptions Next(bool more_follows) {
    grpc::WriteOptions options;
    if (std::exchange(headers_left_, true) && more_follows) options.set_buffer_hint();
    return options;
  }

 private:
  bool headers_left_ = false;  // or will be sent before the next write begins
};

}  // namespace voxelpipe
