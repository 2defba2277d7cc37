// More work than a server can do: it does what it can, refuses the rest at once, and its memory stays bounded.
#include <atomic>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/effort.h"
#include "service/support/process_facts.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::seconds;

// Some ten milliseconds of one core.
VoxelizeRequest Request() {
  VoxelizeRequest request;
  request.grid.resolution = 96;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].components = 3;
  request.targets[0].blend = Blend::kAverage;
  request.targets[0].shader = {"normal", {}};
  return request;
}

// What came of many calls.
struct Tally {
  std::map<absl::StatusCode, int> codes;
  int refused_without_delay = 0, wrong_results = 0;
  std::string strangest;  // an error that is neither success nor refusal
  double served_a_second = 0;

  int of(absl::StatusCode code) const {
    const auto it = codes.find(code);
    return it == codes.end() ? 0 : it->second;
  }
};

// `clients` threads with a connection each, every one of which asks again `pause` after each answer, for so long.
Tally Load(const ServerProcess& server, const std::vector<uint8_t>& glb, const std::string& expected_sha256,
           int clients, std::chrono::microseconds pause, seconds duration) {
  Tally tally;
  std::mutex mutex;
  const auto begin = Clock::now(), end = begin + duration;
  std::vector<std::thread> threads;
  for (int i = 0; i < clients; ++i) {
    threads.emplace_back([&] {
      const std::unique_ptr<Client> client = ConnectTo(server);
      while (client != nullptr && Clock::now() < end) {
        JobContext job;
        job.set_deadline(Clock::now() + kPatience);
        const absl::StatusOr<RemoteResult> result = client->Voxelize(glb, MeshFormat::kGlb, Request(), job);
        {
          const std::lock_guard lock(mutex);
          ++tally.codes[result.status().code()];
          if (result.ok()) {
            tally.wrong_results += !expected_sha256.empty() && result->content_sha256 != expected_sha256;
          } else if (absl::IsResourceExhausted(result.status())) {
            tally.refused_without_delay += !RetryDelay(result.status()).has_value();
          } else {
            tally.strangest = result.status().ToString();
          }
        }
        if (pause.count() > 0) std::this_thread::sleep_for(pause);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  tally.served_a_second = tally.of(absl::StatusCode::kOk) / std::chrono::duration<double>(Clock::now() - begin).count();
  return tally;
}

TEST(OverloadTest, TenTimesTheLoadIsRefusedAndBounded) {
  const std::unique_ptr<ServerProcess> server = StartServer({"--log-level", "error", "--workers", "1", "--threads", "1",
                                                             "--max-queue", "4", "--max-working-bytes", "500000000"});
  ASSERT_NE(server, nullptr);
  const std::vector<uint8_t> glb = TorusGlb(40);
  const std::unique_ptr<Client> client = ConnectTo(*server);
  ASSERT_NE(client, nullptr);
  const JobContext job;
  const absl::StatusOr<RemoteResult> right = client->Voxelize(glb, MeshFormat::kGlb, Request(), job);
  ASSERT_TRUE(right.ok()) << right.status();

  // What it can do: always one that runs and some that wait.
  const Tally alone = Load(*server, glb, right->content_sha256, 4, std::chrono::microseconds(0), seconds(2));
  EXPECT_EQ(alone.of(absl::StatusCode::kOk), alone.codes.begin()->second) << "a load within the limits is refused";
  EXPECT_EQ(alone.codes.size(), 1u);
  const ProcessFacts before = ReadProcessFacts(server->pid());

  // Ten times as many ask, without a pause when they are refused.
  const Tally tally =
      Load(*server, glb, right->content_sha256, 40, std::chrono::microseconds(500), seconds(Effort(5, 60)));
  const ProcessFacts after = ReadProcessFacts(server->pid());
  SCOPED_TRACE("alone " + std::to_string(alone.served_a_second) + " a second, overloaded " +
               std::to_string(tally.served_a_second) + "; refused " +
               std::to_string(tally.of(absl::StatusCode::kResourceExhausted)) + "; before " + before.ToString() +
               "; after " + after.ToString());
  EXPECT_EQ(tally.strangest, "");
  EXPECT_EQ(tally.wrong_results, 0);
  EXPECT_EQ(tally.refused_without_delay, 0);
  EXPECT_GT(tally.of(absl::StatusCode::kResourceExhausted), 0) << "there was no overload";
  // The load generator has the same cores, so this is no measure of the server, only of its getting anything done.
  EXPECT_GT(tally.served_a_second, alone.served_a_second / 10);
  if (!IsSanitized(server->pid())) {
    EXPECT_LT(after.peak_bytes, before.peak_bytes + (uint64_t{100} << 20));
  }
  RecordProperty("alone_per_second", std::to_string(alone.served_a_second));
  RecordProperty("overloaded_per_second", std::to_string(tally.served_a_second));
  RecordProperty("refused", tally.of(absl::StatusCode::kResourceExhausted));

  // And when it is over it is as before.
  EXPECT_TRUE(client->Voxelize(glb, MeshFormat::kGlb, Request(), job).ok());
}

}  // namespace
}  // namespace voxelpipe::testing
