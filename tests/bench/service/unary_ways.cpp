// unary_ways [SECONDS [ROUNDS]]: what a bare unary call (0.3 KB up, 4.7 KB down, 16 in flight, one client that polls)
// costs by the way the server serves it. One line a way, CPU of both processes, the least of the rounds.
//
// By this Voxelize is a raw callback method that its worker finishes: a completion queue of one's own saves some 5
// us of 33 as long as the server has no callback method besides, and nothing as soon as it has one, since then gRPC's
// threads poll the same sockets. A server stream of one message costs about a tenth more than a unary call.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/codegen/server_callback_handlers.h>
#include <grpcpp/impl/service_type.h>
#include <grpcpp/support/async_unary_call.h>

#include "bench/service/polled_unary.h"

namespace voxelpipe::bench {
namespace {

using grpc::ByteBuffer;
using grpc::internal::RpcMethod;
using grpc::internal::RpcServiceMethod;

constexpr char kUnary[] = "/bare.Grpc/Unary", kOther[] = "/bare.Grpc/Other";
constexpr size_t kRequestBytes = 300, kResponseBytes = 4700;
constexpr int kInFlight = 16;

ByteBuffer Bytes(size_t count) {
  const grpc::Slice slice(std::string(count, 'x'));
  return {&slice, 1};
}

// A thread that finishes calls, as a worker does.
class Worker {
 public:
  Worker() : thread_([this] { Serve(); }) { thread_.detach(); }  // the process ends by a signal
  void Post(std::function<void()> job) {
    {
      const std::lock_guard lock(mutex_);
      jobs_.push_back(std::move(job));
    }
    posted_.notify_one();
  }

 private:
  void Serve() {
    std::unique_lock lock(mutex_);
    for (;;) {
      posted_.wait(lock, [this] { return !jobs_.empty(); });
      std::deque<std::function<void()>> jobs;
      jobs.swap(jobs_);
      lock.unlock();
      for (const std::function<void()>& job : jobs) job();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable posted_;
  std::deque<std::function<void()>> jobs_;
  std::thread thread_;
};

class Reactor final : public grpc::ServerUnaryReactor {
 public:
  explicit Reactor(ByteBuffer& response) : response_(response) {}
  void Answer() {
    response_ = Bytes(kResponseBytes);
    Finish(grpc::Status::OK);
  }
  void OnDone() override { delete this; }

 private:
  ByteBuffer& response_;
};

// `worker`: null where gRPC's thread answers.
class CallbackService final : public grpc::Service {
 public:
  CallbackService(const char* method, Worker* worker) {
    AddMethod(new RpcServiceMethod(method, RpcMethod::NORMAL_RPC, nullptr));
    MarkMethodRawCallback(0, new grpc::internal::CallbackUnaryHandler<ByteBuffer, ByteBuffer>(
                                 [worker](grpc::CallbackServerContext*, const ByteBuffer*, ByteBuffer* response) {
                                   auto* reactor = new Reactor(*response);
                                   if (worker != nullptr) {
                                     worker->Post([reactor] { reactor->Answer(); });
                                   } else {
                                     reactor->Answer();
                                   }
                                   return reactor;
                                 }));
  }
};

class StreamReactor final : public grpc::ServerWriteReactor<ByteBuffer> {
 public:
  void Answer() {
    response_ = Bytes(kResponseBytes);
    StartWriteAndFinish(&response_, grpc::WriteOptions(), grpc::Status::OK);
  }
  void OnDone() override { delete this; }

 private:
  ByteBuffer response_;
};

// A server stream of one message, which a worker sends.
class StreamService final : public grpc::Service {
 public:
  explicit StreamService(Worker& worker) {
    AddMethod(new RpcServiceMethod(kUnary, RpcMethod::SERVER_STREAMING, nullptr));
    MarkMethodRawCallback(0, new grpc::internal::CallbackServerStreamingHandler<ByteBuffer, ByteBuffer>(
                                 [&worker](grpc::CallbackServerContext*, const ByteBuffer*) {
                                   auto* reactor = new StreamReactor;
                                   worker.Post([reactor] { reactor->Answer(); });
                                   return reactor;
                                 }));
  }
};

// One that is served from a completion queue of its own.
class QueueService final : public grpc::Service {
 public:
  explicit QueueService(Worker* worker) : worker_(worker) {
    AddMethod(new RpcServiceMethod(kUnary, RpcMethod::NORMAL_RPC, nullptr));
    MarkMethodAsync(0);
  }
  void Serve(grpc::ServerCompletionQueue& queue) {
    for (int i = 0; i < 2 * kInFlight; ++i) AwaitCall(queue);
    void* tag = nullptr;
    bool ok = false;
    while (queue.Next(&tag, &ok)) {
      auto* call = static_cast<Call*>(tag);
      if (!ok || call->answered) {
        delete call;
        continue;
      }
      AwaitCall(queue);
      call->answered = true;
      const auto answer = [call] { call->writer.Finish(Bytes(kResponseBytes), grpc::Status::OK, call); };
      if (worker_ != nullptr) {
        worker_->Post(answer);
      } else {
        answer();
      }
    }
  }

 private:
  struct Call {
    grpc::ServerContext context;
    ByteBuffer request;
    grpc::ServerAsyncResponseWriter<ByteBuffer> writer{&context};
    bool answered = false;
  };
  void AwaitCall(grpc::ServerCompletionQueue& queue) {
    auto* call = new Call;
    RequestAsyncUnary(0, &call->context, &call->request, &call->writer, &queue, &queue, call);
  }

  Worker* const worker_;
};

struct Way {
  const char* name;
  bool queue, worker, beside_callbacks;
  bool stream = false;  // a server stream of one message, which the client reads as one
};
constexpr Way kWays[] = {
    {"callback, answered at once", false, false, false},
    {"callback, answered by a worker", false, true, false},
    {"queue, answered at once", true, false, false},
    {"queue, answered by a worker", true, true, false},
    {"queue beside callbacks, at once", true, false, true},
    {"queue beside callbacks, worker", true, true, true},
    {"server stream of one message", false, true, false, true},
};

// Writes its port into `out` and serves until the process is ended.
[[noreturn]] void ServeAs(const Way& way, int out) {
  const std::unique_ptr<Worker> worker = way.worker ? std::make_unique<Worker>() : nullptr;
  CallbackService callbacks(way.queue ? kOther : kUnary, worker.get());
  QueueService from_queue(worker.get());
  std::optional<StreamService> streams;
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
  if (way.stream) {
    builder.RegisterService(&streams.emplace(*worker));
  } else if (!way.queue || way.beside_callbacks) {
    builder.RegisterService(&callbacks);
  }
  std::unique_ptr<grpc::ServerCompletionQueue> queue;
  if (way.queue) {
    builder.RegisterService(&from_queue);
    queue = builder.AddCompletionQueue();
  }
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (!server || write(out, &port, sizeof port) != sizeof port) _exit(1);
  if (queue) from_queue.Serve(*queue);
  server->Wait();
  _exit(0);
}

// CPU us a call; 0 where the server did not come up.
double Measure(const Way& way, double seconds) {
  int ends[2];
  if (pipe(ends) != 0) return 0;
  const pid_t server = fork();
  if (server == 0) ServeAs(way, ends[1]);
  close(ends[1]);
  int port = 0;
  const bool up = read(ends[0], &port, sizeof port) == sizeof port;
  close(ends[0]);
  double us = 0;
  if (up) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    const auto channel =
        grpc::CreateCustomChannel("127.0.0.1:" + std::to_string(port), grpc::InsecureChannelCredentials(), arguments);
    channel->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(10));
    const auto measure = way.stream ? PolledStreams : PolledUnary;
    us =
        measure(channel, kUnary, Bytes(kRequestBytes), kResponseBytes, kInFlight, seconds, server).cpu_us_per_request();
  }
  kill(server, SIGKILL);
  waitpid(server, nullptr, 0);
  return us;
}

}  // namespace
}  // namespace voxelpipe::bench

// Each measurement in a process of its own: gRPC may not be forked once it was used.
int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 0.5;
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 5;
  for (const voxelpipe::bench::Way& way : voxelpipe::bench::kWays) {
    double least = 0;
    for (int i = 0; i < rounds; ++i) {
      int ends[2];
      if (pipe(ends) != 0) return 1;
      const pid_t child = fork();
      if (child == 0) {
        const double us = voxelpipe::bench::Measure(way, seconds);
        _exit(write(ends[1], &us, sizeof us) == sizeof us ? 0 : 1);
      }
      close(ends[1]);
      double us = 0;
      if (read(ends[0], &us, sizeof us) != sizeof us) us = 0;
      close(ends[0]);
      waitpid(child, nullptr, 0);
      if (us > 0) least = least > 0 ? std::min(least, us) : us;
    }
    std::printf("%-32s %9.1f us\n", way.name, least);
    std::fflush(stdout);
  }
  return 0;
}
