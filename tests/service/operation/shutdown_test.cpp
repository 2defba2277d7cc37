// Shutdown of a server under load: a graceful one loses no accepted call, a sudden one leaves no client waiting.
#include <signal.h>

#include <atomic>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "grpc/health/v1/health.grpc.pb.h"
#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/messages.h"
#include "service/support/raw_client.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using grpc::health::v1::Health;
using grpc::health::v1::HealthCheckRequest;
using grpc::health::v1::HealthCheckResponse;

// Watches a server's health as a load balancer does. Also used to see that the watch ends.
class HealthWatcher {
 public:
  explicit HealthWatcher(const std::string& address)
      : stub_(Health::NewStub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()))), thread_([this] {
          HealthCheckRequest request;
          request.set_service("voxelpipe.v1.VoxelizationService");
          const auto watch = stub_->Watch(&context_, request);
          HealthCheckResponse response;
          while (watch->Read(&response)) serving_ = response.status() == HealthCheckResponse::SERVING;
          serving_ = false;
          status_ = watch->Finish();
        }) {}
  ~HealthWatcher() {
    context_.TryCancel();
    if (thread_.joinable()) thread_.join();
  }
  bool serving() const { return serving_; }
  bool WaitUntilServing() const {
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (!serving_ && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return serving_;
  }
  grpc::Status End() {
    thread_.join();
    return status_;
  }

 private:
  const std::unique_ptr<Health::Stub> stub_;
  grpc::ClientContext context_;
  std::atomic<bool> serving_{false};
  grpc::Status status_;
  std::thread thread_;
};

// Eight clients that ask without a pause while the server says that it serves. Some jobs are large, some leave slab by
// slab. Every call that began before the client learned of the end has its answer.
TEST(ShutdownTest, SigtermUnderLoadLosesNothing) {
  const std::vector<uint8_t> small = TorusGlb(8), slow = LargeTrianglesGlb(LessIfSlow(20));
  constexpr int kClients = 8;
  for (int round = 0; round < 3; ++round) {
    const std::unique_ptr<ServerProcess> server =
        StartServer({"--log-level", "error", "--workers", "2", "--lame-duck-ms", "500", "--stream-above-mb", "1"});
    ASSERT_NE(server, nullptr);
    HealthWatcher health(server->address());
    ASSERT_TRUE(health.WaitUntilServing());
    std::atomic<int> connected{0}, served{0}, served_late{0};
    std::atomic<bool> told{false};
    std::mutex mutex;
    std::map<std::string, int> lost;
    std::vector<std::thread> clients;
    for (int i = 0; i < kClients; ++i) {
      clients.emplace_back([&, i] {
        const std::unique_ptr<Client> client = ConnectTo(*server);
        ++connected;
        for (int k = 0; client != nullptr && health.serving(); ++k) {
          VoxelizeRequest request = SmallRequest();
          if ((i + k) % 4 == 1) request.grid.resolution = 100;
          if ((i + k) % 4 == 2) request = SlowRequest();
          request.grid.resolution = std::min<int64_t>(request.grid.resolution, 128);
          JobContext job;
          job.set_deadline(JobContext::Clock::now() + kPatience);
          const absl::Status status =
              client->Voxelize((i + k) % 4 == 2 ? slow : small, MeshFormat::kGlb, request, job).status();
          if (status.ok()) {
            ++(told ? served_late : served);
          } else {
            const std::lock_guard lock(mutex);
            ++lost[status.ToString()];
          }
        }
      });
    }
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while ((connected < kClients || served < 10 + 7 * round) && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    server->Signal(SIGTERM);
    told = true;
    for (std::thread& client : clients) client.join();
    for (const auto& [status, count] : lost) ADD_FAILURE() << count << " of " << served << " lost: " << status;
    EXPECT_GE(served, 10);
    EXPECT_GT(served_late, 0) << "nothing was under way";
    EXPECT_TRUE(health.End().ok() || !health.serving());
    const absl::StatusOr<CommandResult> end = server->Wait();
    ASSERT_TRUE(end.ok()) << end.status();
    EXPECT_EQ(end->exit_code, 0);
  }
}

// Connections on which nothing goes on, or without traffic, do not hold up the end beyond the grace. (Without
// it, gRPC gives a peer that does not answer its farewell 20 s.)
TEST(ShutdownTest, SilentConnectionsDoNotHoldItUp) {
  const std::unique_ptr<ServerProcess> server =
      StartServer({"--log-level", "error", "--lame-duck-ms", "0", "--drain-grace-ms", "500"});
  ASSERT_NE(server, nullptr);
  const auto nothing = RawClient::Connect(server->address());
  ASSERT_TRUE(nothing.ok()) << nothing.status();
  const auto greeting = RawClient::Connect(server->address());
  ASSERT_TRUE(greeting.ok()) << greeting.status();
  ASSERT_TRUE((*greeting)->Send(http2::Opening()));
  const std::unique_ptr<Client> idle = ConnectTo(*server);
  ASSERT_NE(idle, nullptr);
  server->Signal(SIGTERM);
  const absl::StatusOr<CommandResult> end = server->Wait(std::chrono::seconds(15));
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

// An upload that never ends is not waited for longer than the grace.
TEST(ShutdownTest, AnUnfinishedUploadDoesNotHoldItUp) {
  const std::unique_ptr<ServerProcess> server =
      StartServer({"--log-level", "error", "--lame-duck-ms", "0", "--drain-grace-ms", "300"});
  ASSERT_NE(server, nullptr);
  const auto stub = StubOf(*server);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub->VoxelizeUpload(&context);
  ASSERT_TRUE(stream->Write(UploadOf(RequestOf(SmallRequest()))));
  server->Signal(SIGTERM);
  const absl::StatusOr<CommandResult> end = server->Wait(std::chrono::seconds(20));
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
  EXPECT_FALSE(stream->Finish().ok());
}

// Ten times over: calls in the upload, in the queue, in work and in the download all end with UNAVAILABLE, and so does
// a health watch.
TEST(ShutdownTest, AKilledServerLeavesNobodyWaiting) {
  const std::vector<uint8_t> small = TorusGlb(8);
  VoxelizeRequest large = SmallRequest();
  large.grid.resolution = 256;
  large.targets[0].format = VoxelFormat::kF32;
  large.targets[0].blend = Blend::kMax;
  for (int round = 0; round < 10; ++round) {
    const std::unique_ptr<ServerProcess> server = StartServer(
        {"--log-level", "error", "--workers", "1", "--threads", "1", "--stream-above-mb", "1", "--max-queue", "64"});
    ASSERT_NE(server, nullptr);
    HealthWatcher health(server->address());
    ASSERT_TRUE(health.WaitUntilServing());
    const std::unique_ptr<Client> client = ConnectTo(*server), other = ConnectTo(*server);
    ASSERT_TRUE(client != nullptr && other != nullptr);
    const auto stub = StubOf(*server);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto upload = stub->VoxelizeUpload(&context);
    ASSERT_TRUE(upload->Write(UploadOf(RequestOf(SmallRequest()))));
    std::vector<std::unique_ptr<BackgroundCall>> calls;
    calls.push_back(std::make_unique<BackgroundCall>(*client, small, large));
    if (round % 2 == 0) {
      ASSERT_TRUE(calls[0]->WaitUntilPlanned());
    }
    calls.push_back(std::make_unique<BackgroundCall>(*other, LargeTrianglesGlb(10'000), SlowRequest()));
    for (int i = 0; i < 4; ++i) calls.push_back(std::make_unique<BackgroundCall>(*other, small, SmallRequest()));
    std::this_thread::sleep_for(std::chrono::milliseconds(10 * round));
    server->Signal(SIGKILL);
    for (const auto& call : calls) {
      const absl::Status status = call->Result().status();
      EXPECT_TRUE(status.ok() || absl::IsUnavailable(status)) << status;
    }
    EXPECT_EQ(upload->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_EQ(health.End().error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_TRUE(absl::IsUnavailable(client->CheckHealth()));
  }
}

}  // namespace
}  // namespace voxelpipe::testing
