// Many jobs on one stream.
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <signal.h>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/batch_fixture.h"

namespace voxelpipe::testing {
namespace {

TEST_F(BatchTest, EveryJobGetsTheBytesOfASingleCall) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<VoxelizeRequest> requests;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const int64_t resolution : {9, 33}) {
      VoxelizeRequest request;
      request.grid.resolution = resolution;
      request.result = kind;
      requests.push_back(request);
      request.targets[0].format = VoxelFormat::kF32;
      request.targets[0].components = 3;
      request.targets[0].blend = Blend::kMax;
      request.targets[0].shader = {"normal", {}};
      requests.push_back(request);
    }
  }
  // Two that are larger than one message may be.
  for (const int64_t resolution : {100, 140}) {
    VoxelizeRequest request = requests[1];
    request.grid.resolution = resolution;
    request.grid.fit = GridFit::kCube;
    requests.push_back(request);
  }
  for (size_t i = 0; i < requests.size(); ++i) ASSERT_TRUE(Send(Job(1000 + i, requests[i])));
  stream_->WritesDone();
  const grpc::Status status = Finish();
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(answers_.size(), requests.size());
  for (size_t i = 0; i < requests.size(); ++i) {
    const Received& answer = answers_[1000 + i];
    EXPECT_TRUE(answer.status.ok()) << answer.status.error_message();
    EXPECT_EQ(answer.summaries, 1);
    EXPECT_EQ(answer.in_one_message, answer.messages == 1);
    EXPECT_EQ(answer.in_one_message, answer.bytes.size() <= 1 << 20);
    EXPECT_TRUE(answer.bytes == Single(requests[i])) << i;
  }
}

TEST_F(BatchTest, AnErrorEndsItsJobAndNotTheStream) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest wrong = SmallRequest();
  wrong.targets[0].shader.name = "no_such_shader";
  ASSERT_TRUE(Send(Job(1, wrong)));
  v1::BatchJob broken = JobOf(2, RequestOf(SmallRequest()));
  broken.mutable_request()->mutable_mesh()->mutable_bytes()->set_data("no mesh at all");
  ASSERT_TRUE(Send(broken));
  v1::BatchJob flipped = Job(3, SmallRequest());
  flipped.mutable_request()->mutable_mesh()->mutable_bytes()->mutable_data()->back() ^= 1;
  ASSERT_TRUE(Send(flipped));
  ASSERT_TRUE(Send(Job(4, SmallRequest())));
  stream_->WritesDone();
  EXPECT_TRUE(Finish().ok());
  EXPECT_EQ(answers_[1].status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_NE(answers_[1].status.error_message().find("no_such_shader"), std::string::npos);
  EXPECT_EQ(FieldOf(answers_[1].status), "targets[0].shader") << "as of a single call";
  EXPECT_EQ(answers_[2].status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(answers_[3].status.error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_TRUE(answers_[4].in_one_message);
}

TEST_F(BatchTest, AnIdInHandMayNotComeAgain) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  ASSERT_TRUE(Send(SlowJob(7)));
  ASSERT_TRUE(Send(Job(7, SmallRequest())));
  EXPECT_EQ(Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  ExpectFree();  // the slow job was cancelled with its stream
}

TEST_F(BatchTest, AnIdMayComeAgainAsSoonAsItsAnswerIsThere) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (int i = 0; i < 500; ++i) {
    ASSERT_TRUE(Send(Job(7, SmallRequest())));
    ASSERT_TRUE(Receive()) << i;
    ASSERT_TRUE(answers_[7].in_one_message) << i << ": " << answers_[7].status.error_message();
    answers_.clear();
  }
  stream_->WritesDone();
  EXPECT_FALSE(Receive());
  EXPECT_EQ(stream_->Finish().error_code(), grpc::StatusCode::OK);
}

TEST_F(BatchTest, AStreamThatIsGoneTakesItsJobsWithIt) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  for (uint64_t id = 0; id < 20; ++id) ASSERT_TRUE(Send(SlowJob(id)));
  context_.TryCancel();
  EXPECT_EQ(Finish().error_code(), grpc::StatusCode::CANCELLED);
  ExpectFree();
}

TEST_F(BatchTest, AJobThatIsNotWantedAnyMoreEnds) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  ASSERT_TRUE(Send({SlowJob(1), SlowJob(2), SlowJob(3)}));  // one of them runs, the others wait
  ASSERT_TRUE(Cancel({1, 99, 3, 2, 2}));                    // 99 is of no job
  while (Ended() < 3 && Receive()) {}
  ASSERT_EQ(answers_.size(), 3u);
  for (const auto& [id, answer] : answers_) {
    EXPECT_EQ(answer.status.error_code(), grpc::StatusCode::CANCELLED) << id;
    EXPECT_EQ(answer.headers, 0) << id;
  }
  ExpectFree();
  // Their ids are free, and a cancel of what has ended changes nothing.
  answers_.clear();
  ASSERT_TRUE(Cancel({1, 2, 3}));
  ASSERT_TRUE(Send({Job(1, SmallRequest()), Job(2, SmallRequest())}));
  stream_->WritesDone();
  EXPECT_TRUE(Finish().ok());
  ASSERT_EQ(answers_.size(), 2u);
  for (const auto& [id, answer] : answers_) EXPECT_EQ(answer.summaries, 1) << id;
}

TEST_F(BatchTest, ACancelIsTakenBeforeTheJobsOfItsMessage) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeBatchRequest message;
  *message.add_jobs() = Job(1, SmallRequest());
  message.add_cancel(1);
  ASSERT_TRUE(stream_->Write(message));
  stream_->WritesDone();
  EXPECT_TRUE(Finish().ok());
  EXPECT_TRUE(answers_[1].status.ok()) << answers_[1].status.error_message();
  EXPECT_EQ(answers_[1].summaries, 1);
}

TEST_F(BatchTest, ATimeOutEndsItsJobAlone) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  v1::BatchJob slow = SlowJob(1), none = Job(2, SmallRequest()), negative = Job(3, SmallRequest()),
               patient = Job(4, SmallRequest());
  slow.mutable_timeout()->set_nanos(300'000'000);
  none.mutable_timeout();
  negative.mutable_timeout()->set_seconds(-1);
  patient.mutable_timeout()->set_seconds(std::chrono::seconds(kPatience).count());
  ASSERT_TRUE(Send(slow));
  while (Ended() < 1 && Receive()) {}
  ASSERT_TRUE(Send({none, negative, patient, Job(5, SmallRequest())}));
  stream_->WritesDone();
  EXPECT_TRUE(Finish().ok());
  for (const uint64_t id : {1, 2}) {
    EXPECT_EQ(answers_[id].status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED)
        << answers_[id].status.error_message();
  }
  EXPECT_EQ(answers_[3].status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(answers_[3].status.error_message(), "timeout: must not be negative");
  for (const uint64_t id : {4, 5}) EXPECT_EQ(answers_[id].summaries, 1) << answers_[id].status.error_message();
}

TEST_F(BatchTest, WhoDoesNotReadIsNotRead) {
  ASSERT_NO_FATAL_FAILURE(Start({"--batch-call-jobs", "4", "--stall-timeout-ms", "60000"}));
  EXPECT_EQ(client_->ServerInfo().value_or(ServerDescription{}).batch_jobs, 4u);
  VoxelizeRequest request;  // 1 MiB each
  request.grid.dims = {128, 128, 64};
  request.grid.voxel_size = Vec3d{0.05, 0.05, 0.05};
  request.grid.origin = Vec3d{0, 0, 0};
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].blend = Blend::kReplace;
  const std::vector<uint8_t> mesh = TorusGlb(64);  // some 300 KB, so that 200 of them are more than all buffers
  constexpr int kJobs = 200;
  std::atomic<int> written{0};
  std::thread writer([&] {
    for (uint64_t id = 0; id < kJobs && Send(JobOf(id, RequestOf(request, mesh))); ++id) ++written;
    stream_->WritesDone();
  });
  // Until the writer stands still.
  for (int before = -1; before != written;) {
    before = written;
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
  }
  EXPECT_LT(written, kJobs / 2) << "the server takes more than it may have in hand";
  while (Receive()) {}
  writer.join();
  EXPECT_TRUE(stream_->Finish().ok());
  EXPECT_EQ(answers_.size(), size_t{kJobs});
  for (const auto& [id, answer] : answers_) EXPECT_TRUE(answer.in_one_message) << id;
}

TEST_F(BatchTest, ADrainAnswersWhatIsInHandAndEndsTheStream) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "50"}));
  for (uint64_t id = 0; id < 5; ++id) ASSERT_TRUE(Send(Job(id, SmallRequest())));
  ASSERT_TRUE(Receive());
  server_->Signal(SIGTERM);
  const grpc::Status status = Finish();
  EXPECT_EQ(answers_.size(), 5u);
  for (const auto& [id, answer] : answers_) EXPECT_EQ(answer.summaries, 1) << id;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  const auto ended = server_->Wait();
  ASSERT_TRUE(ended.ok()) << ended.status();
  EXPECT_EQ(ended->exit_code, 0);
}

// As the client library does it: a frame loop that sends and receives on one thread.
TEST_F(BatchTest, AFrameLoopGetsEveryFrame) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  const std::unique_ptr<ManyStream> frames = client_->OpenMany(job, 4);
  const std::string expected = Single(SmallRequest());
  uint64_t sent = 0, received = 0;
  while (received < 50) {
    if (sent < 50 && sent - received < frames->window()) {
      ASSERT_TRUE(frames->Send(sent++, glb_, MeshFormat::kGlb, SmallRequest()).ok());
      if (sent == 50) frames->FinishSending();
      continue;
    }
    const absl::StatusOr<ManyAnswer> answer = frames->Receive();
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_TRUE(answer->result.ok()) << answer->result.status();
    std::string all;
    for (const auto bytes : ArraysOf(answer->result->result)) all.append(bytes.begin(), bytes.end());
    EXPECT_TRUE(all == expected);
    ++received;
  }
  EXPECT_EQ(frames->Receive().status().code(), absl::StatusCode::kOutOfRange);
}

TEST_F(BatchTest, TheLibraryTellsErrorsOfJobsAndOfStreamsApart) {
  ASSERT_NO_FATAL_FAILURE(Start());
  JobContext job;
  const std::unique_ptr<ManyStream> jobs = client_->OpenMany(job);
  VoxelizeRequest wrong = SmallRequest();
  wrong.targets[0].shader.name = "no_such_shader";
  ASSERT_TRUE(jobs->Send(1, glb_, MeshFormat::kGlb, wrong).ok());
  const absl::StatusOr<ManyAnswer> answer = jobs->Receive();
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->id, 1u);
  EXPECT_EQ(answer->result.status().code(), absl::StatusCode::kInvalidArgument);
  // The id is free again; a result of many messages comes in parts.
  VoxelizeRequest large = SmallRequest();
  large.grid.resolution = 140;
  large.grid.fit = GridFit::kCube;
  large.targets[0].format = VoxelFormat::kF32;
  large.targets[0].blend = Blend::kReplace;
  ASSERT_TRUE(jobs->Send(1, glb_, MeshFormat::kGlb, large).ok());
  const absl::StatusOr<ManyAnswer> second = jobs->Receive();
  ASSERT_TRUE(second.ok()) << second.status();
  ASSERT_TRUE(second->result.ok()) << second->result.status();
  EXPECT_EQ(second->result->result.targets[0].size(), 140u * 140 * 140 * 4);
  job.Cancel();
  EXPECT_EQ(jobs->Receive().status().code(), absl::StatusCode::kCancelled);
}

// What travels compressed and without a hash is the same result.
TEST_F(BatchTest, CompressionAndNoHashChangeNoByte) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ConnectOptions options;
  options.timeout = kPatience;
  options.settings.compression = Compression::kZstd;
  options.settings.content_hash = false;
  const auto compressing = Client::Connect(server_->address(), options);
  ASSERT_TRUE(compressing.ok()) << compressing.status();
  for (const int64_t resolution : {32, 300}) {
    VoxelizeRequest request = SmallRequest();
    request.grid.resolution = resolution;
    const JobContext job;
    const auto result = (*compressing)->Voxelize(glb_, MeshFormat::kGlb, request, job);
    ASSERT_TRUE(result.ok()) << result.status();
    std::string all;
    for (const auto bytes : ArraysOf(result->result)) all.append(bytes.begin(), bytes.end());
    EXPECT_TRUE(all == Single(request));
    EXPECT_LT(result->sent_bytes, all.size());
    EXPECT_EQ(result->content_sha256, "");
  }
}

}  // namespace
}  // namespace voxelpipe::testing
