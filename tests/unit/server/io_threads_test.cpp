#include "io_threads.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <latch>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include <grpc/support/cpu.h>
#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// A server that refuses every call, by callback.
class Refuser {
 public:
  Refuser() {
    grpc::ServerBuilder builder;
    builder.RegisterCallbackGenericService(&service_);
    server_ = builder.BuildAndStart();
    io_threads_.emplace(1, server_->InProcessChannel(grpc::ChannelArguments()));
  }
  ~Refuser() {
    io_threads_.reset();
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
  }

  size_t held() const { return io_threads_->held(); }

  // What a call ends with, which one of gRPC's threads takes.
  grpc::StatusCode Answer() {
    constexpr std::chrono::seconds kPatience{60};  // only where none of them is left
    grpc::GenericStub stub(server_->InProcessChannel(grpc::ChannelArguments()));
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const grpc::Slice nothing;
    const grpc::ByteBuffer request(&nothing, 1);
    grpc::ByteBuffer response;
    grpc::CompletionQueue queue;
    grpc::Status status;
    const auto call = stub.PrepareUnaryCall(&context, "/voxelpipe.test/Refused", request, &queue);
    call->StartCall();
    call->Finish(&response, &status, this);
    void* tag = nullptr;
    bool ok = false;
    EXPECT_TRUE(queue.Next(&tag, &ok));
    queue.Shutdown();
    while (queue.Next(&tag, &ok)) {}
    return status.error_code();
  }

 private:
  grpc::CallbackGenericService service_;
  std::unique_ptr<grpc::Server> server_;
  std::optional<IoThreads> io_threads_;
};

size_t AllButOne() {
  return std::clamp<size_t>(gpr_cpu_num_cores() / 2, 2, 16) - 1;
}

TEST(IoThreadsTest, ServersOfOneProcessLeaveOneThreadToAll) {
  auto first = std::make_unique<Refuser>();
  EXPECT_EQ(first->held(), AllButOne());
  Refuser second;
  EXPECT_EQ(second.held(), 0u);
  EXPECT_EQ(first->Answer(), grpc::StatusCode::UNIMPLEMENTED);
  EXPECT_EQ(second.Answer(), grpc::StatusCode::UNIMPLEMENTED);
  first.reset();
  EXPECT_EQ(second.Answer(), grpc::StatusCode::UNIMPLEMENTED);
  Refuser third;
  EXPECT_EQ(third.held(), AllButOne());
  EXPECT_EQ(second.Answer(), grpc::StatusCode::UNIMPLEMENTED);
  EXPECT_EQ(third.Answer(), grpc::StatusCode::UNIMPLEMENTED);
}

TEST(IoThreadsTest, ServersComeAndGo) {
  for (int i = 0; i < 20; ++i) {
    Refuser server;
    EXPECT_EQ(server.held(), AllButOne());
    EXPECT_EQ(server.Answer(), grpc::StatusCode::UNIMPLEMENTED);
  }
}

// Such as those of the server before, which have not quite ended.
TEST(IoThreadsTest, ThreadsThatDoNotServeAreNotCountedOn) {
  const size_t count = AllButOne() + 2;  // more than there can be, however few of the others have their name already
  std::latch named{std::ptrdiff_t(count)}, go{1};
  std::vector<std::jthread> others;
  for (size_t i = 0; i < count; ++i) {
    others.emplace_back([&] {
      pthread_setname_np(pthread_self(), "nexting_thread");
      named.count_down();
      go.wait();
    });
  }
  named.wait();
  {
    Refuser server;
    EXPECT_EQ(server.held(), AllButOne());
    EXPECT_EQ(server.Answer(), grpc::StatusCode::UNIMPLEMENTED);
  }
  go.count_down();
}

}  // namespace
}  // namespace voxelpipe
