// Equal jobs on one stream, on several, and beside single calls: one run for all.
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/http_get.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

constexpr size_t kJobs = 12;
constexpr char kRuns[] = "voxelpipe_device_jobs_total{device=\"cpu\"}";

class BatchSharingTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn", "--http-listen", "127.0.0.1:0", "--backend", "cpu"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    const auto http = server_->http_address();
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *http;
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    job_.set_deadline(JobContext::Clock::now() + kPatience);
  }

  std::string Upload(const std::vector<uint8_t>& bytes) {
    const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(bytes, MeshFormat::kAuto, job_);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.value_or(StoredMesh{}).name;
  }

  // What came for equal jobs on one stream.
  struct Answers {
    size_t computed = 0, from_others = 0;
    std::vector<std::string> hashes;
  };
  // `all_sent` is called before the first answer is waited for.
  Answers Ask(const std::string& id, const VoxelizeRequest& request, size_t jobs,
              const std::function<void()>& all_sent = {}) {
    Answers answers;
    const auto stream = client_->OpenMany(job_);
    for (size_t i = 0; i < jobs; ++i) EXPECT_TRUE(stream->SendStored(i, id, request).ok());
    stream->FinishSending();
    if (all_sent) all_sent();
    for (size_t i = 0; i < jobs; ++i) {
      const absl::StatusOr<ManyAnswer> answer = stream->Receive();
      EXPECT_TRUE(answer.ok()) << answer.status();
      if (!answer.ok()) return answers;
      EXPECT_TRUE(answer->result.ok()) << answer->result.status();
      if (!answer->result.ok()) continue;
      ++(answer->result->cached ? answers.from_others : answers.computed);
      answers.hashes.push_back(answer->result->content_sha256);
    }
    return answers;
  }

  double Sample(const std::string& name) { return SampleOf(HttpGet(http_, "/metrics"), name); }
  // The same of what is counted a moment after its clients have heard.
  double SampleAtLast(const std::string& name, double wanted) {
    for (int i = 0; i < 500 && Sample(name) != wanted; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return Sample(name);
  }

  JobContext job_;
  std::string http_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

// Another job holds the one worker until all of them are there. One result fits into a message, the other leaves in
// pieces.
TEST_F(BatchSharingTest, EqualJobsOfAStreamAreComputedOnce) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const std::vector<uint8_t> slow = LargeTrianglesGlb(LessIfSlow(300));
  const std::string id = Upload(slow);
  double shared = 0, runs = 0;
  for (const int64_t resolution : {64, 128}) {
    VoxelizeRequest request = SlowRequest();
    request.grid.resolution = resolution;
    if (resolution == 64) request.targets[0].format = VoxelFormat::kU8;
    const absl::StatusOr<RemoteResult> single = client_->Voxelize(slow, MeshFormat::kAuto, request, job_);
    ASSERT_TRUE(single.ok()) << single.status();
    BackgroundCall first(*client_, LargeTrianglesGlb(20000), SlowRequest());
    ASSERT_TRUE(first.WaitUntilPlanned());
    const uint64_t uses = client_->GetMesh(id).value_or(StoredMesh{}).uses;
    const Answers answers = Ask(id, request, kJobs, [&] {
      while (client_->GetMesh(id).value_or(StoredMesh{}).uses < uses + kJobs) std::this_thread::yield();
      first.Cancel();
    });
    EXPECT_EQ(answers.computed, 1u);
    EXPECT_EQ(answers.from_others, kJobs - 1);
    EXPECT_EQ(answers.hashes, std::vector<std::string>(kJobs, single->content_sha256));
    runs += 3;  // the single call's, that of the first job, and one for all
    EXPECT_EQ(SampleAtLast(kRuns, runs), runs);
    shared += kJobs - 1;
    EXPECT_EQ(Sample("voxelpipe_jobs_shared_total"), shared);
  }
  EXPECT_EQ(Sample("voxelpipe_jobs_total{code=\"OK\"}"), 2 * (kJobs + 1)) << "each counts";
  // What they held together is free again.
  EXPECT_EQ(SampleAtLast("voxelpipe_memory_bytes{budget=\"working\"}", 0), 0);
}

TEST_F(BatchSharingTest, AStreamThatEndsDoesNotDisturbACallThatWantsTheSame) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const std::string id = Upload(LargeTrianglesGlb(LessIfSlow(1000)));
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  std::promise<void> planned;
  auto call = std::async(std::launch::async, [&] {
    return client_->VoxelizeStored(id, request, job_, {}, [&](const Plan&) { planned.set_value(); });
  });
  ASSERT_EQ(planned.get_future().wait_for(kPatience), std::future_status::ready);
  {
    const auto stream = client_->OpenMany(job_);
    for (size_t i = 0; i < kJobs; ++i) ASSERT_TRUE(stream->SendStored(i, id, request).ok());
    while (client_->GetMesh(id).value_or(StoredMesh{}).uses < kJobs + 1) std::this_thread::yield();
  }  // cancelled
  const auto result = call.get();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_FALSE(result->cached);
}

TEST_F(BatchSharingTest, AKeptResultAnswersAStream) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16MiB"}));
  const std::vector<uint8_t> glb = TorusGlb(12);
  const std::string id = Upload(glb);
  const auto first = client_->VoxelizeStored(id, SmallRequest(), job_);
  ASSERT_TRUE(first.ok()) << first.status();
  const Answers answers = Ask(id, SmallRequest(), kJobs);
  EXPECT_EQ(answers.from_others, kJobs);
  EXPECT_EQ(answers.hashes, std::vector<std::string>(kJobs, first->content_sha256));
  EXPECT_EQ(Sample("voxelpipe_result_cache_hits_total"), kJobs);
  EXPECT_EQ(Sample("voxelpipe_result_cache_misses_total"), 1);
  EXPECT_EQ(Sample("voxelpipe_jobs_shared_total"), 0) << "nothing ran at the same time";
}

TEST_F(BatchSharingTest, WithoutSharingEachIsComputed) {
  ASSERT_NO_FATAL_FAILURE(Start({"--share-equal-jobs", "false"}));
  const std::string id = Upload(TorusGlb(12));
  EXPECT_EQ(Ask(id, SmallRequest(), kJobs).computed, kJobs);
  EXPECT_EQ(Sample("voxelpipe_jobs_shared_total"), 0);
}

}  // namespace
}  // namespace voxelpipe::testing
