// Messages of VoxelizeMany that hold several jobs, or several answers.
#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/many_fixture.h"

namespace voxelpipe::testing {
namespace {

class ManyMessagesTest : public ManyTest {
 protected:
  // Sends all as one message.
  void Send(const std::vector<v1::VoxelizeManyRequest>& items, bool takes_more) {
    v1::VoxelizeManyRequest message = items.front();
    for (size_t i = 1; i < items.size(); ++i) *message.add_more() = items[i];
    message.set_takes_more(takes_more);
    ASSERT_TRUE(stream_->Write(message));
    stream_->WritesDone();
  }
  // Reads to the end.
  void Receive() {
    v1::VoxelizeManyResponse response;
    while (stream_->Read(&response)) {
      ++messages_;
      Take(response);
      for (const v1::VoxelizeManyResponse& more : response.more()) {
        EXPECT_EQ(more.more_size(), 0);
        Take(more);
      }
    }
    status_ = stream_->Finish();
  }
  void Take(const v1::VoxelizeManyResponse& response) { Add(response, answers_[response.id()]); }

  // Refused at once: all of a message are answered before the first answer has left.
  std::vector<v1::VoxelizeManyRequest> Refused(size_t count) const {
    VoxelizeRequest wrong = SmallRequest();
    wrong.targets[0].shader.name = "no_such_shader";
    std::vector<v1::VoxelizeManyRequest> items;
    for (size_t id = 1; id <= count; ++id) items.push_back(Item(id, wrong));
    return items;
  }

  std::map<uint64_t, JobAnswer> answers_;
  size_t messages_ = 0;
  grpc::Status status_;
};

TEST_F(ManyMessagesTest, JobsOfOneMessageGetTheBytesOfSingleCalls) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<VoxelizeRequest> requests;
  std::vector<v1::VoxelizeManyRequest> items;
  // The last two are larger than one message may be.
  for (const int64_t resolution : {9, 17, 33, 50, 100, 140}) {
    VoxelizeRequest request = SmallRequest();
    request.grid.resolution = resolution;
    request.grid.fit = GridFit::kCube;
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].blend = Blend::kReplace;
    items.push_back(Item(items.size(), request));
    requests.push_back(request);
  }
  ASSERT_NO_FATAL_FAILURE(Send(items, true));
  Receive();
  ASSERT_TRUE(status_.ok()) << status_.error_message();
  ASSERT_EQ(answers_.size(), requests.size());
  for (size_t i = 0; i < requests.size(); ++i) {
    EXPECT_EQ(answers_[i].summaries, 1) << i;
    EXPECT_TRUE(answers_[i].bytes == Single(requests[i])) << i;
  }
}

TEST_F(ManyMessagesTest, AnswersLeaveTogetherForWhoTakesThem) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(Send(Refused(256), true));
  Receive();
  EXPECT_TRUE(status_.ok()) << status_.error_message();
  EXPECT_EQ(answers_.size(), 256u);
  for (const auto& [id, answer] : answers_) EXPECT_EQ(answer.error, grpc::StatusCode::INVALID_ARGUMENT) << id;
  EXPECT_LT(messages_, 128u);
}

TEST_F(ManyMessagesTest, ButOneByOneForWhoDidNotSaySo) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(Send(Refused(256), false));
  Receive();
  EXPECT_TRUE(status_.ok()) << status_.error_message();
  EXPECT_EQ(answers_.size(), 256u);
  EXPECT_EQ(messages_, 256u);
}

TEST_F(ManyMessagesTest, AMessageHoldsNoMoreThanItMay) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(Send(Refused(257), true));
  Receive();
  EXPECT_EQ(status_.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status_.error_message(), "more: a message of 257 jobs; at most 256 are allowed");
}

TEST_F(ManyMessagesTest, MoreHoldsNoMore) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<v1::VoxelizeManyRequest> items = {Item(1, SmallRequest()), Item(2, SmallRequest())};
  *items[1].add_more() = Item(3, SmallRequest());
  ASSERT_NO_FATAL_FAILURE(Send(items, true));
  Receive();
  EXPECT_EQ(status_.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status_.error_message(), "more: job 2 holds more itself");
  EXPECT_TRUE(answers_.empty());
}

TEST_F(ManyMessagesTest, AnIdMayNotComeTwiceInAMessage) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  std::vector<v1::VoxelizeManyRequest> items = {Item(1, SlowRequest()), Item(1, SlowRequest())};
  const std::vector<uint8_t> endless = LargeTrianglesGlb(20000);
  for (v1::VoxelizeManyRequest& item : items) {
    item.set_mesh(endless.data(), endless.size());
    item.clear_crc32c();
  }
  ASSERT_NO_FATAL_FAILURE(Send(items, true));
  Receive();
  EXPECT_EQ(status_.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  ExpectFree();
}

// As the client library takes them.
TEST_F(ManyMessagesTest, TheLibraryTakesAnswersThatCameTogether) {
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
