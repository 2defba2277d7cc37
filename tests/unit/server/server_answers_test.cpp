// VoxelServer::Answers, by which the watchdog knows that the server works.
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/byte_buffer.h>

#include "gtest/gtest.h"
#include "io_threads.h"
#include "server.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::seconds kPatience{60};

// A call without a handler, whose end the test receives.
struct Call {
  grpc::ClientContext context;
  const grpc::Slice nothing;
  const grpc::ByteBuffer request{&nothing, 1};
  grpc::ByteBuffer response;
};

TEST(ServerAnswersTest, NotWhileGrpcsThreadsAreStuck) {
  ServerOptions options;
  options.listen = "127.0.0.1:0";
  options.io_threads = 1;
  const auto server = VoxelServer::Start(options);
  ASSERT_TRUE(server.ok()) << server.status();
  EXPECT_TRUE((*server)->Answers(kPatience));

  // As many calls as there are threads, and each end blocks the thread that reports it, as a deadlock would.
  std::mutex mutex;
  std::condition_variable changed;
  bool released = false;
  size_t stuck = 0, ended = 0;
  std::vector<std::unique_ptr<Call>> calls;
  grpc::GenericStub stub(grpc::CreateChannel((*server)->address(), grpc::InsecureChannelCredentials()));
  for (size_t i = 0; i < IoThreads::Count(); ++i) {
    Call& call = *calls.emplace_back(std::make_unique<Call>());
    stub.UnaryCall(&call.context, "/voxelpipe.test/Nothing", {}, &call.request, &call.response,
                   [&](const grpc::Status&) {
                     std::unique_lock lock(mutex);
                     ++stuck;
                     changed.notify_all();
                     changed.wait(lock, [&] { return released; });
                     ++ended;
                     changed.notify_all();
                   });
  }
  {
    std::unique_lock lock(mutex);
    ASSERT_TRUE(changed.wait_for(lock, kPatience, [&] { return stuck > 0; }));  // the one that serves
  }
  EXPECT_FALSE((*server)->Answers(std::chrono::milliseconds(500)));
  {
    std::unique_lock lock(mutex);
    released = true;
    changed.notify_all();
    ASSERT_TRUE(changed.wait_for(lock, kPatience, [&] { return ended == calls.size(); }));
  }
  EXPECT_TRUE((*server)->Answers(kPatience));
}

}  // namespace
}  // namespace voxelpipe
