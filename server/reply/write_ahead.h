// Which messages of a stream may lie in gRPC until the next one comes.
#pragma once

#include <utility>

#include <grpcpp/grpcpp.h>

namespace voxelpipe {

// The options of one call's writes, in their order. Not thread-safe.
//
// A write with the buffer hint is done as soon as gRPC has it, and its bytes leave with those of a later write, so that
// several go in one packet. Never the first write of a call: it carries the headers, and is not done before they have
// left, which the hint puts off, too. The call would wait for that write and the write for the call's next one, until
// something else leaves on the connection.
class WriteAhead {
 public:
  // Of the next write. `more_follows`: once it is done, the call writes or finishes at once, whatever happens, and
  // waits for no write before.
  grpc::WriteOptions Next(bool more_follows) {
    grpc::WriteOptions options;
    if (std::exchange(headers_left_, true) && more_follows) options.set_buffer_hint();
    return options;
  }

 private:
  bool headers_left_ = false;  // or will have by the time that the next write begins
};

}  // namespace voxelpipe
