// What goes wrong is answered with the right code and words, and the server lives on.
#include <signal.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/checksum/crc32c.h"
#include "base/limit_error.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/closed_port.h"
#include "voxelpipe/v1/error.pb.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

// With SlowRequest, more work than any test waits for.
std::vector<uint8_t> EndlessMesh() {
  return LargeTrianglesGlb(20000);
}

class FailureTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    stub_ = StubOf(*server_);
  }

  absl::Status Ask(const std::vector<uint8_t>& bytes, const VoxelizeRequest& request = SmallRequest()) {
    const JobContext job;
    return client_->Voxelize(bytes, MeshFormat::kAuto, request, job).status();
  }

  void ExpectAlive() {
    EXPECT_TRUE(server_->IsRunning());
    const absl::Status status = Ask(glb_);
    EXPECT_TRUE(status.ok()) << status;
  }

  // Sends these messages as they are, half-closes, and reads to the end.
  grpc::Status Send(const std::vector<v1::VoxelizeUploadRequest>& messages) {
    return CallUpload(*stub_, messages).status;
  }

  static v1::VoxelizeUploadRequest First() {
    v1::VoxelizeUploadRequest message;
    message.mutable_request()->mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(16);
    return message;
  }
  static v1::VoxelizeUploadRequest Piece(const std::vector<uint8_t>& bytes) { return PieceOf(bytes); }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

#define EXPECT_STATUS(expression, code_, text)                     \
  {                                                                \
    const absl::Status& status_ = (expression);                    \
    EXPECT_EQ(status_.code(), absl::StatusCode::code_) << status_; \
    EXPECT_THAT(std::string(status_.message()), HasSubstr(text));  \
  }

TEST_F(FailureTest, BadBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  EXPECT_STATUS(Ask({}), kInvalidArgument, "");
  EXPECT_STATUS(Ask(std::vector<uint8_t>(1000, 0)), kInvalidArgument, "");
  const std::string text = "not a mesh at all";
  EXPECT_STATUS(Ask({text.begin(), text.end()}), kInvalidArgument, "");
  ExpectAlive();
}

TEST_F(FailureTest, TruncatedFile) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (size_t length : {size_t{4}, size_t{12}, size_t{19}, size_t{100}, glb_.size() / 2, glb_.size() - 1}) {
    EXPECT_STATUS(Ask({glb_.begin(), glb_.begin() + ptrdiff_t(length)}), kInvalidArgument, "");
  }
  ExpectAlive();
}

TEST_F(FailureTest, IndexOutOfRangeIsNamed) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<uint8_t> bytes = glb_;
  // The JSON keeps its length: one accessor claims nine times its elements.
  std::string text(bytes.begin(), bytes.end());
  const size_t at = text.find("\"count\":81");
  ASSERT_NE(at, std::string::npos);
  bytes[at + 8] = '9';
  EXPECT_STATUS(Ask(bytes), kInvalidArgument, "ccessor");
  ExpectAlive();
}

TEST_F(FailureTest, UploadBeyondTheLimitIsRefusedEarly) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-file-bytes", "100000"}));
  // Far more than all the buffers between us: without the early answer this would have to be sent whole.
  EXPECT_STATUS(Ask(std::vector<uint8_t>(256u << 20, 'x')), kResourceExhausted, "100000");
  ExpectAlive();
}

// An estimate holds its mesh while it waits, as a job does.
TEST_F(FailureTest, TheMeshOfAnEstimateTakesRoomOfTheUploads) {
  const size_t begun = 1000;
  ASSERT_NO_FATAL_FAILURE(Start({"--max-upload-bytes", std::to_string(glb_.size() + begun - 1)}));
  v1::EstimateVoxelizationRequest request;
  request.mutable_mesh()->mutable_bytes()->set_data(glb_.data(), glb_.size());
  const auto estimate = [&] {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    v1::EstimateVoxelizationResponse response;
    return stub_->EstimateVoxelization(&context, request, &response);
  };
  EXPECT_TRUE(estimate().ok());
  grpc::ClientContext context;
  const auto upload = stub_->VoxelizeUpload(&context);
  ASSERT_TRUE(upload->Write(First()));
  ASSERT_TRUE(upload->Write(Piece({glb_.begin(), glb_.begin() + begun})));
  grpc::Status status;
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  do {  // until the piece is there
    status = estimate();
  } while (status.ok() && std::chrono::steady_clock::now() < give_up);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
  EXPECT_TRUE(RetryDelay(FromGrpcStatus(status)).has_value());
  context.TryCancel();
  upload->Finish();
}

TEST_F(FailureTest, AnEstimateSaysWhatItsMeshMayBe) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto expect_invalid = [&](const v1::EstimateVoxelizationRequest& request, const std::string& begin) {
    v1::EstimateVoxelizationResponse response;
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const grpc::Status status = stub_->EstimateVoxelization(&context, request, &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
    EXPECT_TRUE(status.error_message().starts_with(begin)) << status.error_message();
  };
  v1::EstimateVoxelizationRequest request;
  expect_invalid(request, "mesh: neither a mesh nor a summary");
  request.mutable_mesh();
  expect_invalid(request, "");
  request.mutable_mesh()->mutable_stored();
  expect_invalid(request, "mesh.stored.name: ");
  request.mutable_mesh()->mutable_stored()->set_name("some");
  expect_invalid(request, "mesh.stored.name: ");
  const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(glb_, MeshFormat::kAuto, JobContext());
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  request.mutable_mesh()->mutable_stored()->set_name(mesh->name);
  request.mutable_mesh()->mutable_stored()->mutable_positions();
  expect_invalid(request, "mesh.stored.positions: ");
}

// What all uploads together may take, one may: to wait would not help it.
TEST_F(FailureTest, AFileThatNeverFitsIsNotToldToComeAgain) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-upload-bytes", "1000"}));
  const absl::Status status = Ask(glb_);
  EXPECT_STATUS(status, kResourceExhausted, "larger than the limit of 1000 bytes");
  EXPECT_FALSE(RetryDelay(status).has_value());
}

TEST_F(FailureTest, MessagesOutOfOrder) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto expect_invalid = [](const grpc::Status& status, const std::string& begin) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
    EXPECT_FALSE(status.error_message().empty());
    EXPECT_TRUE(status.error_message().starts_with(begin)) << status.error_message();
  };
  expect_invalid(Send({}), "request: the stream ended without one");
  expect_invalid(Send({Piece(glb_)}), "request: must come before the mesh");
  expect_invalid(Send({v1::VoxelizeUploadRequest()}), "message: ");
  expect_invalid(Send({First(), First(), Piece(glb_)}), "request: only the first message may be one");
  expect_invalid(Send({First(), Piece(glb_), First()}), "request: only the first message may be one");
  expect_invalid(Send({First()}), "");
  EXPECT_TRUE(Send({First(), Piece(glb_)}).ok());
  ExpectAlive();
}

// Pieces of any size, the empty one too.
TEST_F(FailureTest, PiecesMayBeSmall) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<v1::VoxelizeUploadRequest> messages{First()};
  for (size_t i = 0; i < glb_.size(); i += 7) {
    messages.push_back(Piece({glb_.begin() + ptrdiff_t(i), glb_.begin() + ptrdiff_t(std::min(i + 7, glb_.size()))}));
  }
  messages.push_back(Piece({}));
  const grpc::Status status = Send(messages);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

// A first part of the mesh may be in the request itself.
TEST_F(FailureTest, TheRequestMayHoldTheBeginningOfTheMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string expected = CallUpload(*stub_, {First(), Piece(glb_)}).bytes;
  ASSERT_FALSE(expected.empty());
  for (const size_t begun : {size_t{1}, glb_.size() / 2, glb_.size()}) {
    v1::VoxelizeUploadRequest first = First();
    v1::MeshBytes& mesh = *first.mutable_request()->mutable_mesh()->mutable_bytes();
    mesh.set_data(glb_.data(), begun);
    mesh.set_crc32c(Crc32c({glb_.data(), begun}));
    EXPECT_EQ(CallUpload(*stub_, {first, Piece({glb_.begin() + ptrdiff_t(begun), glb_.end()})}).bytes, expected);
    mesh.set_crc32c(mesh.crc32c() ^ 1);
    EXPECT_EQ(Send({first}).error_code(), grpc::StatusCode::DATA_LOSS);
  }
}

TEST_F(FailureTest, WhatTheRequestNamesWrongly) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.targets[0].shader.name = "no_such_shader";
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "no_such_shader");
  request = SmallRequest();
  request.targets[0].shader = {"constant", {{"colour", {1}}}};
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "colour");
  request = SmallRequest();
  request.targets[0].blend = Blend::kAdd;
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "blend");
  request = SmallRequest();
  request.targets[0].components = 3;
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "components");
  request = SmallRequest();
  request.grid.resolution = 0;
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "resolution");
  request = SmallRequest();
  request.grid.dims = {4, 4, 4};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "origin");
  request = SmallRequest();
  request.targets.assign(9, TargetSpec{});
  EXPECT_STATUS(Ask(glb_, request), kInvalidArgument, "targets");
  request = SmallRequest();
  request.backend = BackendChoice::kCuda;
  EXPECT_STATUS(Ask(glb_, request), kFailedPrecondition, "CUDA");
  ExpectAlive();
}

TEST_F(FailureTest, EnumsOfTheFutureAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeUploadRequest first = First();
  first.mutable_request()->mutable_spec()->set_fill(v1::Fill(99));
  EXPECT_EQ(Send({first, Piece(glb_)}).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  first = First();
  first.mutable_request()->mutable_spec()->add_targets()->set_format(v1::VoxelFormat(99));
  EXPECT_EQ(Send({first, Piece(glb_)}).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(FailureTest, InvalidArgumentCarriesTheField) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeUploadRequest first = First();
  first.mutable_request()->mutable_spec()->add_targets()->mutable_shader()->set_name("nothing");
  const grpc::Status status = Send({first, Piece(glb_)});
  EXPECT_EQ(ReasonOf(status), "INVALID_REQUEST");
  EXPECT_THAT(FieldOf(status), HasSubstr("targets[0]"));
}

TEST_F(FailureTest, InvalidArgumentCarriesThePartOfTheMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto field = [&](const std::vector<uint8_t>& mesh) {
    const grpc::Status status = Send({First(), Piece(mesh)});
    EXPECT_EQ(ReasonOf(status), "INVALID_MESH");
    return FieldOf(status);
  };
  EXPECT_EQ(field({}), "mesh");
  EXPECT_EQ(field({'n', 'o', ' ', 'm', 'e', 's', 'h'}), "mesh");
  EXPECT_EQ(field({glb_.begin(), glb_.begin() + ptrdiff_t(glb_.size() / 2)}), "GLB: byte 8");
  std::vector<uint8_t> bytes = glb_;
  const std::string text(bytes.begin(), bytes.end());
  bytes[text.find("\"count\":81") + 8] = '9';
  EXPECT_EQ(field(bytes), "glTF: mesh 0, primitive 0");
}

TEST_F(FailureTest, GridBeyondTheLimits) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-result-bytes", "1000000"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 1024;
  EXPECT_STATUS(Ask(glb_, request), kResourceExhausted, "1000000");

  v1::VoxelizeUploadRequest first = First();
  first.mutable_request()->mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(1024);
  const grpc::Status status = Send({first, Piece(glb_)});
  EXPECT_EQ(ReasonOf(status), "LIMIT_EXCEEDED");
  const auto limit = DetailOf<v1::LimitExceeded>(status);
  EXPECT_EQ(limit.limit_bytes(), 1'000'000);
  EXPECT_GT(limit.need_bytes(), 1'000'000);
  const int64_t largest = limit.resolution();
  request.grid.resolution = largest;
  EXPECT_TRUE(Ask(glb_, request).ok()) << largest;
  request.grid.resolution = largest + 1;
  const absl::Status refused = Ask(glb_, request);
  ASSERT_TRUE(LimitErrorOf(refused).has_value()) << refused;
  EXPECT_EQ(LimitErrorOf(refused)->largest_resolution, largest);

  request.grid.resolution = 1 << 20;
  EXPECT_STATUS(Ask(glb_, request), kResourceExhausted, "");
  ExpectAlive();
}

TEST_F(FailureTest, CancelFreesTheWorker) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  BackgroundCall call(*client_, EndlessMesh(), SlowRequest());
  ASSERT_TRUE(call.WaitFor("fine_raster"));
  const auto before = std::chrono::steady_clock::now();
  call.Cancel();
  EXPECT_EQ(call.Result().status().code(), absl::StatusCode::kCancelled);
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(10));
  ExpectAlive();  // the one worker is free again
}

// Nothing tells a client that it waits, so the cancel comes at several moments: before, while and after the job is
// queued.
TEST_F(FailureTest, CancelWhileWaitingInTheQueue) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1", "--max-queue", "1"}));
  BackgroundCall running(*client_, EndlessMesh(), SlowRequest());
  ASSERT_TRUE(running.WaitUntilPlanned());
  const std::unique_ptr<Client> other = ConnectTo(*server_);
  // The server learns of a cancellation a little after its client does, so the queue's one place may still be taken
  // when the next call comes: that one is refused, and asks again.
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  for (int cancelled = 0; cancelled < 10;) {
    BackgroundCall waiting(*other, glb_, SmallRequest());
    std::this_thread::sleep_for(std::chrono::milliseconds(5 * cancelled));
    waiting.Cancel();
    const absl::StatusCode code = waiting.Result().status().code();
    if (code == absl::StatusCode::kCancelled) {
      ++cancelled;
      continue;
    }
    ASSERT_EQ(code, absl::StatusCode::kResourceExhausted);
    ASSERT_LT(std::chrono::steady_clock::now(), give_up) << "a cancelled call keeps its place in the queue";
  }
  EXPECT_FALSE(running.IsOver());
  running.Cancel();
  EXPECT_EQ(running.Result().status().code(), absl::StatusCode::kCancelled);
  absl::Status after = Ask(glb_);
  while (absl::IsResourceExhausted(after) && std::chrono::steady_clock::now() < give_up) after = Ask(glb_);
  EXPECT_TRUE(after.ok()) << after;  // with a queue of one: those that were cancelled have left it
}

TEST_F(FailureTest, Deadlines) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  JobContext expired;
  expired.set_deadline(JobContext::Clock::now() - std::chrono::seconds(1));
  EXPECT_STATUS(client_->Voxelize(glb_, MeshFormat::kGlb, SmallRequest(), expired).status(), kDeadlineExceeded, "");

  JobContext soon;
  soon.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(700));
  EXPECT_STATUS(client_->Voxelize(EndlessMesh(), MeshFormat::kGlb, SlowRequest(), soon).status(), kDeadlineExceeded,
                "");
  EXPECT_LT(JobContext::Clock::now() - *soon.deadline(), std::chrono::seconds(10));
  ExpectAlive();
}

// A client that vanishes in the middle of its upload leaves nothing behind.
TEST_F(FailureTest, UploadGivenUp) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    auto stream = stub_->VoxelizeUpload(&context);
    stream->Write(First());
    stream->Write(Piece(glb_));
    context.TryCancel();
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  ExpectAlive();
}

// The exception reaches the caller, and the call is over by then.
TEST_F(FailureTest, ACallbackThatThrows) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const JobContext job;
  const auto throws = [](const Plan&) { throw std::runtime_error("enough"); };
  EXPECT_THROW((void)client_->Voxelize(EndlessMesh(), MeshFormat::kGlb, SlowRequest(), job, throws),
               std::runtime_error);
  ExpectAlive();
}

TEST(NoServerTest, ConnectionRefusedNamesTheTarget) {
  const ClosedPort closed_port;
  const absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(closed_port.address());
  ASSERT_FALSE(client.ok());
  EXPECT_STATUS(client.status(), kUnavailable, closed_port.address());
}

TEST(NoServerTest, ServerThatDiesIsUnavailable) {
  const std::unique_ptr<ServerProcess> server = StartServer({"--log-level", "warn"});
  ASSERT_NE(server, nullptr);
  const std::unique_ptr<Client> client = ConnectTo(*server);
  ASSERT_NE(client, nullptr);
  BackgroundCall call(*client, EndlessMesh(), SlowRequest());
  ASSERT_TRUE(call.WaitUntilPlanned());
  server->Signal(SIGKILL);
  EXPECT_STATUS(call.Result().status(), kUnavailable, server->address());
}

}  // namespace
}  // namespace voxelpipe::testing
