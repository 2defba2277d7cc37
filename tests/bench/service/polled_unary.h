// Unary calls from one thread that looks at all of them: the cheapest client that gRPC has.
#pragma once

#include <sys/types.h>

#include <memory>

#include <grpcpp/channel.h>
#include <grpcpp/support/byte_buffer.h>

#include "bench/service/cpu_clock.h"

namespace voxelpipe::bench {

// Calls `method` of the process `server` with `request`, `in_flight` calls at a time, for so long. Calls that fail do
// not count. `response`: bytes of an answer, for the rate.
Measured PolledUnary(const std::shared_ptr<grpc::Channel>& channel, const char* method, const grpc::ByteBuffer& request,
                     size_t response, int in_flight, double seconds, pid_t server);

}  // namespace voxelpipe::bench
