// Small calls from one polling thread: the cheapest client of gRPC.
#pragma once

#include <sys/types.h>

#include <memory>

#include <grpcpp/channel.h>
#include <grpcpp/support/byte_buffer.h>

#include "bench/service/cpu_clock.h"

namespace voxelpipe::bench {

// Calls `method` of the process `server` with `request`, `in_flight` calls at a time, for `seconds`. Failed calls do
// not count. `response`: bytes of a response, for the rate.
Measured PolledUnary(const std::shared_ptr<grpc::Channel>& channel, const char* method, const grpc::ByteBuffer& request,
                     size_t response, int in_flight, double seconds, pid_t server);

// The same for server streams of one message.
Measured PolledStreams(const std::shared_ptr<grpc::Channel>& channel, const char* method,
                       const grpc::ByteBuffer& request, size_t response, int in_flight, double seconds, pid_t server);

}  // namespace voxelpipe::bench
