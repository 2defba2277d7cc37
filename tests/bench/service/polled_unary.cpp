#include "bench/service/polled_unary.h"

#include <chrono>
#include <deque>
#include <optional>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/async_stream.h>

namespace voxelpipe::bench {

namespace {

// Keeps `in_flight` calls going for `seconds`. `start(call, queue)` begins a call, whose events have its address as
// tag; `advance(call)` takes an event of one, and returns true at the end of the call.
template <typename Call, typename Start, typename Advance>
Measured Poll(int in_flight, double seconds, pid_t server, size_t bytes_per_call, const Start& start,
              const Advance& advance) {
  grpc::CompletionQueue queue;
  std::deque<Call> calls{size_t(in_flight)};
  const auto begin = [&](Call& call) {
    call.reader.reset();  // owned by the call, which the next context releases
    call.context.emplace();
    start(call, queue);
  };
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const Span span(server);
  for (Call& call : calls) begin(call);
  double done = 0;
  void* tag = nullptr;
  bool ok = false;
  for (int left = in_flight; left > 0 && queue.Next(&tag, &ok);) {
    Call& call = *static_cast<Call*>(tag);
    if (!advance(call)) continue;
    if (call.status.ok()) ++done;
    if (std::chrono::steady_clock::now() < end) {
      begin(call);
    } else {
      --left;
    }
  }
  return span.End(done, done * double(bytes_per_call));
}

}  // namespace

Measured PolledUnary(const std::shared_ptr<grpc::Channel>& channel, const char* method, const grpc::ByteBuffer& request,
                     size_t response, int in_flight, double seconds, pid_t server) {
  struct Call {
    std::optional<grpc::ClientContext> context;
    grpc::ByteBuffer answer;
    grpc::Status status;
    std::unique_ptr<grpc::GenericClientAsyncResponseReader> reader;
  };
  grpc::GenericStub stub(channel);
  const auto start = [&](Call& call, grpc::CompletionQueue& queue) {
    call.reader = stub.PrepareUnaryCall(&*call.context, method, request, &queue);
    call.reader->StartCall();
    call.reader->Finish(&call.answer, &call.status, &call);
  };
  return Poll<Call>(in_flight, seconds, server, request.Length() + response, start, [](Call&) { return true; });
}

Measured PolledStreams(const std::shared_ptr<grpc::Channel>& channel, const char* method,
                       const grpc::ByteBuffer& request, size_t response, int in_flight, double seconds, pid_t server) {
  enum class Step { kSent, kRead, kFinished };
  struct Call {
    std::optional<grpc::ClientContext> context;
    grpc::ByteBuffer answer;
    grpc::Status status;
    std::unique_ptr<grpc::ClientAsyncReader<grpc::ByteBuffer>> reader;
    Step step = Step::kSent;  // the last one that was started
  };
  using Factory = grpc::internal::ClientAsyncReaderFactory<grpc::ByteBuffer>;
  const grpc::internal::RpcMethod rpc(method, grpc::internal::RpcMethod::SERVER_STREAMING);
  const auto start = [&](Call& call, grpc::CompletionQueue& queue) {
    call.step = Step::kSent;
    call.reader.reset(Factory::Create(channel.get(), &queue, rpc, &*call.context, request, true, &call));
  };
  const auto advance = [](Call& call) {
    if (call.step == Step::kFinished) return true;
    if (call.step == Step::kSent) {
      call.step = Step::kRead;
      call.reader->Read(&call.answer, &call);
    } else {
      call.step = Step::kFinished;
      call.reader->Finish(&call.status, &call);
    }
    return false;
  };
  return Poll<Call>(in_flight, seconds, server, request.Length() + response, start, advance);
}

}  // namespace voxelpipe::bench
