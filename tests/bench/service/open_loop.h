// Bare gRPC under an open loop of requests.
#pragma once

#include <memory>

#include <grpcpp/channel.h>

#include "bench/histogram.h"
#include "bench/service/cpu_clock.h"

namespace voxelpipe::bench {

struct OpenLoop {
  Measured measured;
  cli::Histogram latency_ns;  // from the scheduled send time, as in voxelpipe bench
};

// Unary calls of `request` bytes up and `response` down against a ServeBareGrpc process, `rate` a second at random for
// `seconds`. One thread sends and one receives, as in voxelpipe bench.
OpenLoop OpenLoopUnary(const std::shared_ptr<grpc::Channel>& channel, pid_t server, size_t request, size_t response,
                       double rate, double seconds);

}  // namespace voxelpipe::bench
