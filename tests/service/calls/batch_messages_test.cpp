// Messages of VoxelizeBatch that hold several jobs, or several replies.
#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/batch_fixture.h"
#include "support/slowdown.h"

namespace voxelpipe::testing {
namespace {

class BatchMessagesTest : public BatchTest {
 protected:
  // Sends all as one message, and reads to the end.
  void SendAll(const std::vector<v1::BatchJob>& jobs) {
    ASSERT_TRUE(Send(jobs));
    stream_->WritesDone();
    status_ = Finish();
  }

  // Refused at once: all of a message are answered before the first reply has left.
  std::vector<v1::BatchJob> Refused(size_t count) const {
    VoxelizeRequest wrong = SmallRequest();
    wrong.targets[0].shader.name = "no_such_shader";
    std::vector<v1::BatchJob> jobs;
    for (size_t id = 1; id <= count; ++id) jobs.push_back(Job(id, wrong));
    return jobs;
  }

  grpc::Status status_;
};

TEST_F(BatchMessagesTest, JobsOfOneMessageGetTheBytesOfSingleCalls) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<VoxelizeRequest> requests;
  std::vector<v1::BatchJob> jobs;
  // The last two are larger than one message may be.
  for (const int64_t resolution : {9, 17, 33, 50, 100, 140}) {
    VoxelizeRequest request = SmallRequest();
    request.grid.resolution = resolution;
    request.grid.fit = GridFit::kCube;
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].blend = Blend::kReplace;
    jobs.push_back(Job(jobs.size(), request));
    requests.push_back(request);
  }
  ASSERT_NO_FATAL_FAILURE(SendAll(jobs));
  ASSERT_TRUE(status_.ok()) << status_.error_message();
  ASSERT_EQ(answers_.size(), requests.size());
  for (size_t i = 0; i < requests.size(); ++i) {
    EXPECT_EQ(answers_[i].summaries, 1) << i;
    EXPECT_TRUE(answers_[i].bytes == Single(requests[i])) << i;
  }
}

TEST_F(BatchMessagesTest, AnswersLeaveTogether) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(SendAll(Refused(256)));
  EXPECT_TRUE(status_.ok()) << status_.error_message();
  EXPECT_EQ(answers_.size(), 256u);
  for (const auto& [id, answer] : answers_) {
    EXPECT_EQ(answer.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << id;
  }
  // A sanitizer makes refusing slower than sending: then each answer leaves before the next one is there.
  if (kSlowdown == 1) {
    EXPECT_LT(messages_, 128u);
  }
}

TEST_F(BatchMessagesTest, AMessageHoldsNoMoreThanItMay) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(SendAll(Refused(257)));
  EXPECT_EQ(status_.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status_.error_message(), "jobs: a message of 257 jobs; at most 256 are allowed");
  EXPECT_TRUE(answers_.empty());
}

TEST_F(BatchMessagesTest, AMessageMayHoldNothing) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_TRUE(Send(std::vector<v1::BatchJob>()));
  ASSERT_NO_FATAL_FAILURE(SendAll({Job(1, SmallRequest())}));
  EXPECT_TRUE(status_.ok()) << status_.error_message();
  EXPECT_EQ(answers_[1].summaries, 1);
}

TEST_F(BatchMessagesTest, AnIdMayNotComeTwiceInAMessage) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  ASSERT_NO_FATAL_FAILURE(SendAll({SlowJob(1), SlowJob(1)}));
  EXPECT_EQ(status_.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  ExpectFree();
}

// As the client library takes them.
TEST_F(BatchMessagesTest, TheLibraryTakesAnswersThatCameTogether) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  const std::unique_ptr<ManyStream> jobs = client_->OpenMany(job, 200);
  const std::string expected = Single(SmallRequest());
  std::map<uint64_t, int> received;
  for (uint64_t id = 0; id < 200; ++id) ASSERT_TRUE(jobs->Send(id, glb_, MeshFormat::kGlb, SmallRequest()).ok());
  jobs->FinishSending();
  for (int i = 0; i < 200; ++i) {
    const absl::StatusOr<ManyAnswer> answer = jobs->Receive();
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_TRUE(answer->result.ok()) << answer->result.status();
    ++received[answer->id];
    std::string all;
    for (const auto bytes : ArraysOf(answer->result->result)) all.append(bytes.begin(), bytes.end());
    EXPECT_TRUE(all == expected);
  }
  EXPECT_EQ(received.size(), 200u);
  EXPECT_EQ(jobs->Receive().status().code(), absl::StatusCode::kOutOfRange);
}

}  // namespace
}  // namespace voxelpipe::testing
