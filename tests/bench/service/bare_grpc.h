// The baseline of any gRPC service: a server that does nothing, and its client.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

#include <grpcpp/channel.h>
#include <grpcpp/support/byte_buffer.h>

#include "bench/service/cpu_clock.h"

namespace voxelpipe::bench {

// A certificate that both sides trust, and its key: PEM files. Empty: plain text.
struct BareTls {
  std::string cert_file, key_file;
};

// Serves until the process is ended. Prints its port on the first line of stdout.
int ServeBareGrpc(const BareTls& tls);

// The unary method, and a request of `request` bytes for an answer of `response`.
inline constexpr char kUnaryMethod[] = "/bare.Grpc/Unary";
grpc::ByteBuffer UnaryRequest(size_t request, size_t response);

// The client's side. Each call is one measurement against a ServeBareGrpc process `server` at 127.0.0.1:`port`.
class BareGrpc {
 public:
  BareGrpc(pid_t server, int port, const BareTls& tls);

  // A stream of `total` bytes in messages of `piece`: prepared slices, read on arrival. The same slice repeatedly, or,
  // if `wide`, successive slices of 128 MiB, as in a large result.
  Measured RawStream(size_t piece, size_t total, bool wide = false);
  // The same with a message with a bytes field, as in generated code.
  Measured BytesStream(size_t piece, size_t total);
  // A client stream: the same slice repeatedly, read on arrival and discarded.
  Measured RawUpload(size_t piece, size_t total);
  // Unary calls of `request` bytes up and `response` down, `in_flight` threads with one at a time each.
  Measured Unary(size_t request, size_t response, int in_flight, double seconds);
  // The same from one thread that polls, as voxelpipe bench does.
  Measured UnaryPolled(size_t request, size_t response, int in_flight, double seconds);
  // Small messages on one bidirectional stream, at most `window` of them outstanding.
  Measured Bidirectional(size_t request, size_t response, int window, double seconds);

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  const pid_t server_;
  const std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace voxelpipe::bench
