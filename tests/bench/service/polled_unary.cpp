#include "bench/service/polled_unary.h"

#include <chrono>
#include <deque>
#include <optional>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/async_stream.h>

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
  grpc::CompletionQueue queue;
  std::deque<Call> calls{size_t(in_flight)};
  const auto start = [&](Call& call) {
    call.reader.reset();
    call.context.emplace();
    call.step = Step::kSent;
    call.reader.reset(Factory::Create(channel.get(), &queue, rpc, &*call.context, request, true, &call));
  };
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const Span span(server);
  for (Call& call : calls) start(call);
  double done = 0;
  void* tag = nullptr;
  bool ok = false;
  for (int left = in_flight; left > 0 && queue.Next(&tag, &ok);) {
    Call& call = *static_cast<Call*>(tag);
    if (call.step == Step::kSent) {
      call.step = Step::kRead;
      call.reader->Read(&call.answer, &call);
      continue;
    }
    if (call.step == Step::kRead) {
      call.step = Step::kFinished;
      call.reader->Finish(&call.status, &call);
      continue;
    }
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
