// Many jobs on one stream.
#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <signal.h>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/many_fixture.h"

namespace voxelpipe::testing {
namespace {

TEST_F(ManyTest, EveryJobGetsTheBytesOfASingleCall) {
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
  for (size_t i = 0; i < requests.size(); ++i) ASSERT_TRUE(stream_->Write(Item(1000 + i, requests[i])));
  stream_->WritesDone();
  std::map<uint64_t, JobAnswer> answers;
  v1::VoxelizeManyResponse response;
  while (stream_->Read(&response)) Add(response, answers[response.id()]);
  const grpc::Status status = stream_->Finish();
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(answers.size(), requests.size());
  for (size_t i = 0; i < requests.size(); ++i) {
    const JobAnswer& answer = answers[1000 + i];
    EXPECT_EQ(answer.error, 0);
    EXPECT_EQ(answer.summaries, 1);
    EXPECT_EQ(answer.whole, answer.parts == 0 ? 1 : 0);
    EXPECT_EQ(answer.parts > 0, answer.bytes.size() > 1 << 20);
    EXPECT_TRUE(answer.bytes == Single(requests[i])) << i;
  }
}

TEST_F(ManyTest, AnErrorEndsItsJobAndNotTheStream) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest wrong = SmallRequest();
  wrong.targets[0].shader.name = "no_such_shader";
  ASSERT_TRUE(stream_->Write(Item(1, wrong)));
  v1::VoxelizeManyRequest broken = Item(2, SmallRequest());
  broken.set_mesh("no mesh at all");
  broken.clear_crc32c();
  ASSERT_TRUE(stream_->Write(broken));
  v1::VoxelizeManyRequest flipped = Item(3, SmallRequest());
  flipped.mutable_mesh()->back() ^= 1;
  ASSERT_TRUE(stream_->Write(flipped));
  ASSERT_TRUE(stream_->Write(Item(4, SmallRequest())));
  stream_->WritesDone();
  std::map<uint64_t, JobAnswer> answers;
  v1::VoxelizeManyResponse response;
  while (stream_->Read(&response)) {
    Add(response, answers[response.id()]);
    if (response.id() == 1) {
      EXPECT_NE(response.error().message().find("no_such_shader"), std::string::npos);
      EXPECT_EQ(response.error().details_size(), 1) << "which field, as of a single call";
    }
  }
  EXPECT_TRUE(stream_->Finish().ok());
  EXPECT_EQ(answers[1].error, grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(answers[2].error, grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(answers[3].error, grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(answers[4].whole, 1);
}

TEST_F(ManyTest, AnIdInHandMayNotComeAgain) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  v1::VoxelizeManyRequest slow = Item(7, SlowRequest());
  const std::vector<uint8_t> endless = LargeTrianglesGlb(20000);
  slow.set_mesh(endless.data(), endless.size());
  slow.clear_crc32c();
  ASSERT_TRUE(stream_->Write(slow));
  ASSERT_TRUE(stream_->Write(Item(7, SmallRequest())));
  v1::VoxelizeManyResponse response;
  while (stream_->Read(&response)) {}
  EXPECT_EQ(stream_->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  ExpectFree();  // the slow job was cancelled with its stream
}

TEST_F(ManyTest, AnIdMayComeAgainAsSoonAsItsAnswerIsThere) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeManyResponse response;
  for (int i = 0; i < 500; ++i) {
    ASSERT_TRUE(stream_->Write(Item(7, SmallRequest())));
    ASSERT_TRUE(stream_->Read(&response)) << i;
    ASSERT_TRUE(response.has_whole()) << i << ": " << response.ShortDebugString();
  }
  stream_->WritesDone();
  EXPECT_FALSE(stream_->Read(&response));
  EXPECT_EQ(stream_->Finish().error_code(), grpc::StatusCode::OK);
}

TEST_F(ManyTest, AStreamThatIsGoneTakesItsJobsWithIt) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const std::vector<uint8_t> endless = LargeTrianglesGlb(20000);
  for (uint64_t id = 0; id < 20; ++id) {
    v1::VoxelizeManyRequest slow = Item(id, SlowRequest());
    slow.set_mesh(endless.data(), endless.size());
    slow.clear_crc32c();
    ASSERT_TRUE(stream_->Write(slow));
  }
  context_.TryCancel();
  v1::VoxelizeManyResponse response;
  while (stream_->Read(&response)) {}
  EXPECT_EQ(stream_->Finish().error_code(), grpc::StatusCode::CANCELLED);
  ExpectFree();
}

TEST_F(ManyTest, WhoDoesNotReadIsNotRead) {
  ASSERT_NO_FATAL_FAILURE(Start({"--many-in-flight", "4", "--stall-timeout-ms", "60000"}));
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
    for (uint64_t id = 0; id < kJobs; ++id) {
      v1::VoxelizeManyRequest item = Item(id, request);
      item.set_mesh(mesh.data(), mesh.size());
      item.clear_crc32c();
      if (!stream_->Write(item)) break;
      ++written;
    }
    stream_->WritesDone();
  });
  // Until the writer stands still.
  for (int before = -1; before != written;) {
    before = written;
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
  }
  EXPECT_LT(written, kJobs / 2) << "the server takes more than it may have in hand";
  std::map<uint64_t, JobAnswer> answers;
  v1::VoxelizeManyResponse response;
  while (stream_->Read(&response)) Add(response, answers[response.id()]);
  writer.join();
  EXPECT_TRUE(stream_->Finish().ok());
  EXPECT_EQ(answers.size(), size_t{kJobs});
  for (const auto& [id, answer] : answers) EXPECT_EQ(answer.whole, 1) << id;
}

TEST_F(ManyTest, ADrainAnswersWhatIsInHandAndEndsTheStream) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "50"}));
  for (uint64_t id = 0; id < 5; ++id) ASSERT_TRUE(stream_->Write(Item(id, SmallRequest())));
  v1::VoxelizeManyResponse response;
  ASSERT_TRUE(stream_->Read(&response));
  server_->Signal(SIGTERM);
  int answers = 1;
  while (stream_->Read(&response)) ++answers;
  EXPECT_EQ(answers, 5);
  EXPECT_EQ(stream_->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  const auto ended = server_->Wait();
  ASSERT_TRUE(ended.ok()) << ended.status();
  EXPECT_EQ(ended->exit_code, 0);
}

// As the client library does it: a frame loop that sends and receives on one thread.
TEST_F(ManyTest, AFrameLoopGetsEveryFrame) {
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

TEST_F(ManyTest, TheLibraryTellsErrorsOfJobsAndOfStreamsApart) {
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
TEST_F(ManyTest, CompressionAndNoHashChangeNoByte) {
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
