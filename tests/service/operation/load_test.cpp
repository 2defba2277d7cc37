// Many clients at once.
#include <algorithm>
#include <future>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

VoxelizeRequest RequestNumber(int i) {
  VoxelizeRequest request;
  request.grid.resolution = 8 + i % 5;
  if (i % 3 == 1) request.fill = Fill::kParity;
  if (i % 3 == 2) {
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].components = 3;
    request.targets[0].blend = Blend::kAdd;
    request.targets[0].shader = {"normal", {}};
  }
  return request;
}
constexpr int kKinds = 15;  // different requests among these

TEST(LoadTest, TwoHundredAtOnceAreAllServed) {
  const std::unique_ptr<ServerProcess> server = StartServer({"--log-level", "warn"});
  ASSERT_NE(server, nullptr);
  const std::vector<uint8_t> glb = TorusGlb(10);

  // One after the other first: what each answer must be.
  std::vector<std::string> expected;
  expected.reserve(kKinds);
  const std::unique_ptr<Client> first = ConnectTo(*server);
  ASSERT_NE(first, nullptr);
  for (int i = 0; i < kKinds; ++i) {
    const JobContext job;
    const absl::StatusOr<RemoteResult> result = first->Voxelize(glb, MeshFormat::kGlb, RequestNumber(i), job);
    ASSERT_TRUE(result.ok()) << result.status();
    expected.push_back(result->content_sha256);
  }
  // At the coarsest, parity has nothing to add to the shell; else all differ, so that a mixed-up answer is seen.
  ASSERT_GE(std::set<std::string>(expected.begin(), expected.end()).size(), 10u);

  constexpr int kCalls = 200, kClients = 10;
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < kClients; ++i) {
    clients.push_back(ConnectTo(*server));
    ASSERT_NE(clients.back(), nullptr);
  }
  std::promise<void> start;
  const std::shared_future<void> started = start.get_future().share();
  std::vector<std::future<absl::StatusOr<std::string>>> calls;
  calls.reserve(kCalls);
  for (int i = 0; i < kCalls; ++i) {
    calls.push_back(std::async(std::launch::async, [&, i]() -> absl::StatusOr<std::string> {
      started.wait();
      JobContext job;
      job.set_deadline(JobContext::Clock::now() + kPatience);
      absl::StatusOr<RemoteResult> result =
          clients[size_t(i % kClients)]->Voxelize(glb, MeshFormat::kGlb, RequestNumber(i), job);
      if (!result.ok()) return result.status();
      return result->content_sha256;
    }));
  }
  start.set_value();
  for (int i = 0; i < kCalls; ++i) {
    const absl::StatusOr<std::string> hash = calls[size_t(i)].get();
    ASSERT_TRUE(hash.ok()) << "call " << i << ": " << hash.status();
    EXPECT_EQ(*hash, expected[size_t(i % kKinds)]) << "call " << i;
  }
}

TEST(LoadTest, AFullQueueAsksToComeAgain) {
  const std::unique_ptr<ServerProcess> server =
      StartServer({"--log-level", "warn", "--workers", "1", "--threads", "1", "--max-queue", "2"});
  ASSERT_NE(server, nullptr);
  const std::unique_ptr<Client> client = ConnectTo(*server);
  ASSERT_NE(client, nullptr);
  VoxelizeRequest endless;
  endless.grid.resolution = 256;
  endless.targets[0].format = VoxelFormat::kF32;
  endless.targets[0].blend = Blend::kMax;
  endless.targets[0].shader = {"barycentric", {}};
  BackgroundCall running(*client, LargeTrianglesGlb(20000), endless);
  ASSERT_TRUE(running.WaitUntilPlanned());

  // The worker is taken: of eight more, two wait and six are sent away at once.
  std::vector<std::unique_ptr<BackgroundCall>> more;
  more.reserve(8);
  for (int i = 0; i < 8; ++i) more.push_back(std::make_unique<BackgroundCall>(*client, TorusGlb(8), RequestNumber(i)));
  const auto over = [&] { return std::count_if(more.begin(), more.end(), [](auto& call) { return call->IsOver(); }); };
  for (const auto deadline = JobContext::Clock::now() + kPatience; over() < 6;) {
    ASSERT_LT(JobContext::Clock::now(), deadline) << over() << " were sent away";
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  std::vector<BackgroundCall*> waiting;
  for (const auto& call : more) {
    if (!call->IsOver()) {
      waiting.push_back(call.get());
      continue;
    }
    const absl::Status status = call->Result().status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_TRUE(RetryDelay(status).has_value()) << "says when to come again";
  }
  ASSERT_EQ(waiting.size(), 2u);
  EXPECT_FALSE(running.IsOver());
  running.Cancel();
  for (BackgroundCall* call : waiting) {
    const absl::StatusOr<RemoteResult> result = call->Result();
    EXPECT_TRUE(result.ok()) << result.status();
  }
}

}  // namespace
}  // namespace voxelpipe::testing
