// Equal requests for a stored mesh: run once, kept, streamed to each client.
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/effort.h"
#include "service/support/mesh_store_fixture.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"

namespace voxelpipe::testing {
namespace {

// Sixteen clients want the same of a mesh that takes a while: one run, sixteen equal answers.
TEST_F(MeshStoreTest, EqualRequestsAtTheSameTimeAreComputedOnce) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "2"}));
  const std::vector<uint8_t> slow = LargeTrianglesGlb(LessIfSlow(3000));
  const std::string name = Upload(slow).name;
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  std::vector<std::future<absl::StatusOr<RemoteResult>>> calls;
  for (int i = 0; i < 16; ++i) {
    calls.push_back(std::async(std::launch::async, [&] { return client_->VoxelizeStored(name, request, job_); }));
  }
  int computed = 0;
  std::string hash;
  for (auto& call : calls) {
    const auto result = call.get();
    ASSERT_TRUE(result.ok()) << result.status();
    if (!result->cached) ++computed;
    if (hash.empty()) hash = result->content_sha256;
    EXPECT_EQ(result->content_sha256, hash);
  }
  EXPECT_EQ(computed, 1);
  EXPECT_EQ(HashOfFile(slow, request), hash);
}

TEST_F(MeshStoreTest, WhoCancelsDoesNotDisturbWhoWantsTheSame) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1"}));
  const std::string name = Upload(LargeTrianglesGlb(LessIfSlow(3000))).name;
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  JobContext first_job;
  std::promise<void> planned;
  auto first = std::async(std::launch::async, [&] {
    return client_->VoxelizeStored(name, request, first_job, {}, [&](const Plan&) { planned.set_value(); }).status();
  });
  ASSERT_EQ(planned.get_future().wait_for(kPatience), std::future_status::ready);
  auto second = std::async(std::launch::async, [&] { return client_->VoxelizeStored(name, request, job_); });
  while (client_->GetMesh(name).value_or(StoredMesh{}).uses < 2) std::this_thread::yield();  // it has asked
  first_job.Cancel();
  EXPECT_TRUE(absl::IsCancelled(first.get()));
  const auto result = second.get();
  EXPECT_TRUE(result.ok()) << result.status();

  // And when no client waits for it any more, the one worker is free at once.
  JobContext slow_job;
  std::promise<void> began;
  request.grid.resolution = 512;
  auto slow = std::async(std::launch::async, [&] {
    return client_->VoxelizeStored(name, request, slow_job, {}, [&](const Plan&) { began.set_value(); }).status();
  });
  ASSERT_EQ(began.get_future().wait_for(kPatience), std::future_status::ready);
  slow_job.Cancel();
  EXPECT_TRUE(absl::IsCancelled(slow.get()));
  HashOfStored(name, SmallRequest());
}

TEST_F(MeshStoreTest, AKeptResultIsTheSameBytes) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16MiB"}));
  const std::string name = Upload(glb_).name;
  for (const VoxelizeRequest& request : Requests()) {
    const auto first = client_->VoxelizeStored(name, request, job_),
               again = client_->VoxelizeStored(name, request, job_);
    ASSERT_TRUE(first.ok()) << first.status();
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_FALSE(first->cached);
    EXPECT_TRUE(again->cached);
    EXPECT_EQ(first->content_sha256, again->content_sha256);
    EXPECT_EQ(first->result.grid, again->result.grid);
    EXPECT_EQ(first->report.triangles, again->report.triangles);
  }
}

// Results of several slabs leave while they are made, each for its own client.
TEST_F(MeshStoreTest, LargeResultsAreStreamedToEachWhoAsks) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "0", "--workers", "2"}));
  const std::string name = Upload(glb_).name;
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 96;
  const std::string expected = HashOfFile(glb_, request);
  std::vector<std::future<std::string>> hashes;
  for (int i = 0; i < 4; ++i) {
    hashes.push_back(std::async(std::launch::async, [&] { return HashOfStored(name, request); }));
  }
  for (auto& hash : hashes) EXPECT_EQ(hash.get(), expected);
}

}  // namespace
}  // namespace voxelpipe::testing
