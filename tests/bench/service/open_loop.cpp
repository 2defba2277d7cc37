#include "bench/service/open_loop.h"

#include <atomic>
#include <chrono>
#include <thread>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>

#include "bench/arrivals.h"
#include "bench/service/bare_grpc.h"

namespace voxelpipe::bench {
namespace {

using Clock = std::chrono::steady_clock;

struct Call {
  grpc::ClientContext context;
  std::unique_ptr<grpc::GenericClientAsyncResponseReader> reader;
  grpc::ByteBuffer answer;
  grpc::Status status;
  Clock::time_point due;
};

}  // namespace

OpenLoop OpenLoopUnary(const std::shared_ptr<grpc::Channel>& channel, pid_t server, size_t request, size_t response,
                       double rate, double seconds) {
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  const grpc::ByteBuffer message = UnaryRequest(request, response);
  cli::ArrivalSchedule schedule(rate, cli::Arrivals::kPoisson, 1);
  OpenLoop result;
  uint64_t done = 0;  // the receiver's, until it is joined
  const Span span(server);
  std::thread receiver([&] {
    void* tag = nullptr;
    bool ok = false;
    while (queue.Next(&tag, &ok)) {
      const std::unique_ptr<Call> call(static_cast<Call*>(tag));
      if (!ok || !call->status.ok()) continue;
      result.latency_ns.Add(uint64_t(std::chrono::nanoseconds(Clock::now() - call->due).count()));
      ++done;
    }
  });
  const Clock::time_point begin = Clock::now();
  for (Clock::time_point due = begin + schedule.Next(); due < begin + std::chrono::duration<double>(seconds);
       due = begin + schedule.Next()) {
    std::this_thread::sleep_until(due);
    auto call = std::make_unique<Call>();
    call->due = due;
    call->reader = stub.PrepareUnaryCall(&call->context, kUnaryMethod, message, &queue);
    call->reader->StartCall();
    Call* const tag = call.release();
    tag->reader->Finish(&tag->answer, &tag->status, tag);
  }
  queue.Shutdown();  // what is under way still comes
  receiver.join();
  result.measured = span.End(double(done), double(done) * double(request + response));
  return result;
}

}  // namespace voxelpipe::bench
