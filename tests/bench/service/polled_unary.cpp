#include "bench/service/polled_unary.h"

#include <chrono>
#include <deque>
#include <optional>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>

namespace voxelpipe::bench {

Measured PolledUnary(const std::shared_ptr<grpc::Channel>& channel, const char* method, const grpc::ByteBuffer& request,
                     size_t response, int in_flight, double seconds, pid_t server) {
  struct Call {
    std::optional<grpc::ClientContext> context;
    grpc::ByteBuffer answer;
    grpc::Status status;
    std::unique_ptr<grpc::GenericClientAsyncResponseReader> reader;
  };
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  std::deque<Call> calls{size_t(in_flight)};
  const auto start = [&](Call& call) {
    call.reader.reset();
    call.context.emplace();
    call.reader = stub.PrepareUnaryCall(&*call.context, method, request, &queue);
    call.reader->StartCall();
    call.reader->Finish(&call.answer, &call.status, &call);
  };
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const Span span(server);
  for (Call& call : calls) start(call);
  double done = 0;
  void* tag = nullptr;
  bool ok = false;
  for (int left = in_flight; left > 0 && queue.Next(&tag, &ok);) {
    Call& call = *static_cast<Call*>(tag);
    if (call.status.ok()) ++done;
    if (std::chrono::steady_clock::now() < end) {
      start(call);
    } else {
      --left;
    }
  }
  return span.End(done, done * double(request.Length() + response));
}

}  // namespace voxelpipe::bench
