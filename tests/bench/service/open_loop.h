// Bare gRPC under requests that come when they come.
#pragma once

#include <memory>

#include <grpcpp/channel.h>

#include "bench/histogram.h"
#include "bench/service/cpu_clock.h"

namespace voxelpipe::bench {

struct OpenLoop {
  Measured measured;
  cli::Histogram latency_ns;  // since a request was due, as voxelpipe bench has it
};

// Unary calls of `request` bytes up and `response` down against a ServeBareGrpc process, `rate` a second at random for
// `seconds`. One thread sends and one receives, as in voxelpipe bench.
OpenLoop OpenLoopUnary(const std::shared_ptr<grpc::Channel>& channel, pid_t server, size_t request, size_t response,
                       double rate, double seconds);

}  // namespace voxelpipe::bench
