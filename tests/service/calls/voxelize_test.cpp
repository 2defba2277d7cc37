// Voxelize: one message in, the same as of VoxelizeUpload out, in bytes, errors and rules. Small results come in one
// message.
#include <signal.h>

#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/http_get.h"
#include "service/support/messages.h"
#include "service/support/raw_client.h"
#include "service/support/raw_messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

VoxelizeRequest Normals(int64_t resolution, ResultKind kind) {
  VoxelizeRequest request;
  request.grid.resolution = resolution;
  request.result = kind;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].components = 3;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"normal", {}};
  return request;
}

// A small result of a lot of work, which keeps the one worker.
VoxelizeRequest SmallAndSlow() {
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 60;
  return request;
}

class VoxelizeTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn", "--http-listen", "127.0.0.1:0"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    stub_ = StubOf(*server_);
  }

  static v1::VoxelizeRequest Message(const VoxelizeRequest& request, const std::vector<uint8_t>& mesh) {
    return RequestOf(request, mesh, MeshFormat::kAuto);
  }
  Received Call(const v1::VoxelizeRequest& message, std::chrono::milliseconds timeout = kPatience) {
    return testing::Call(*stub_, message, timeout);
  }
  // The same job by VoxelizeUpload.
  Received Upload(const v1::VoxelizeRequest& message) { return CallUpload(*stub_, message); }

  double Sample(const std::string& name) {
    const auto http = server_->http_address();
    EXPECT_TRUE(http.ok()) << http.status();
    return http.ok() ? SampleOf(HttpGet(*http, "/metrics"), name) : -1;
  }
  // True if it becomes true in time; calls are counted when gRPC is done with them, a moment after their clients.
  bool Soon(const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }
  double Calls(const std::string& code, const std::string& method = "Voxelize") {
    return Sample("voxelpipe_calls_total{code=\"" + code + "\",method=\"" + method + "\"}");
  }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

TEST_F(VoxelizeTest, TheBytesAreThoseOfAnUpload) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<VoxelizeRequest> requests;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const int64_t resolution : {1, 9, 33, 100}) {
      requests.push_back(Normals(resolution, kind));
      requests.push_back(requests.back());
      requests.back().targets = VoxelizeRequest().targets;
    }
  }
  for (const VoxelizeRequest& request : requests) {
    const v1::VoxelizeRequest message = Message(request, glb_);
    const Received answer = Call(message), upload = Upload(message);
    ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
    ASSERT_TRUE(upload.status.ok()) << upload.status.error_message();
    EXPECT_TRUE(answer.bytes == upload.bytes);
    for (const Received* received : {&answer, &upload}) {
      EXPECT_EQ(received->in_one_message, upload.bytes.size() <= 1 << 20);
      EXPECT_TRUE(!received->in_one_message || received->messages == 1 + int(received->stages.size()))
          << received->messages;
      EXPECT_EQ(received->summary.content_sha256(), upload.summary.content_sha256());
      EXPECT_EQ(received->summary.result_bytes(), int64_t(upload.bytes.size()));
      EXPECT_EQ(received->summary.stats().triangles(), 128);
      EXPECT_EQ(received->plans, 1);
      EXPECT_EQ(received->header.grid().dims().SerializeAsString(), received->plan.grid().dims().SerializeAsString());
    }
  }
}

TEST_F(VoxelizeTest, SmallSlabsAreGathered) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "0"}));
  const v1::VoxelizeRequest message = Message(Normals(40, ResultKind::kDense), glb_);
  const Received answer = Call(message);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  EXPECT_TRUE(answer.in_one_message);
  EXPECT_LT(answer.plan.slab_depth(), answer.plan.grid().dims().z());
  EXPECT_EQ(answer.summary.content_sha256(), Upload(message).summary.content_sha256());
}

TEST_F(VoxelizeTest, AStoredMeshCompressionAndNoHashAreAsInAnUpload) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16MiB"}));
  const JobContext job;
  const auto mesh = client_->UploadMesh(glb_, MeshFormat::kGlb, job);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  v1::VoxelizeRequest message = StoredRequestOf(Normals(20, ResultKind::kDense), mesh->name);
  const Received first = Call(message), again = Call(message);
  ASSERT_TRUE(first.status.ok() && again.status.ok());
  EXPECT_FALSE(first.summary.cached());
  EXPECT_TRUE(again.summary.cached());
  EXPECT_EQ(first.summary.content_sha256(), again.summary.content_sha256());
  message.mutable_delivery()->set_compression(v1::COMPRESSION_ZSTD);
  const Received packed = Call(message);
  ASSERT_TRUE(packed.status.ok());
  EXPECT_LT(packed.summary.sent_bytes(), packed.summary.result_bytes());
  EXPECT_EQ(packed.summary.content_sha256(), Upload(message).summary.content_sha256());
  message.mutable_delivery()->set_compression(v1::COMPRESSION_NONE);
  message.mutable_delivery()->set_content_hash(false);
  const Received bare = Call(message);
  ASSERT_TRUE(bare.status.ok());
  EXPECT_EQ(bare.summary.content_sha256(), "");
  EXPECT_EQ(bare.bytes, first.bytes);
}

TEST_F(VoxelizeTest, EveryErrorIsThatOfAnUpload) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-result-bytes", "2000000", "--max-file-bytes", "1048576"}));
  std::vector<v1::VoxelizeRequest> wrong(14, Message(SmallRequest(), glb_));
  wrong[0].mutable_spec()->mutable_targets(0)->mutable_shader()->set_name("nothing");
  wrong[1].mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(-1);
  wrong[2].mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(1024);  // beyond the server's limit
  wrong[3] = StoredRequestOf(SmallRequest(), "meshes/" + std::string(64, 'a'));
  wrong[4] = StoredRequestOf(SmallRequest(), "no name");
  wrong[5].mutable_mesh()->mutable_bytes()->set_data("no mesh at all");
  wrong[6].mutable_mesh()->mutable_bytes()->clear_data();
  wrong[7].mutable_mesh()->mutable_bytes()->set_crc32c(1);
  wrong[8].mutable_execution()->set_backend(v1::BACKEND_CUDA);
  wrong[9].mutable_mesh()->mutable_bytes()->set_data(std::string((1 << 20) + 1, ' '));
  wrong[10].mutable_mesh()->mutable_bytes()->set_unit(v1::LENGTH_UNIT_INCH);  // the file has one
  wrong[11].mutable_mesh()->mutable_bytes()->set_format(v1::MESH_FORMAT_STL);
  wrong[12].clear_mesh();
  wrong[13].mutable_mesh()->mutable_stored();
  // It has a GPU.
  if (Upload(wrong[8]).status.ok()) wrong[8].mutable_execution()->set_backend(v1::Backend(99));
  for (size_t i = 0; i < wrong.size(); ++i) {
    const grpc::Status told = Call(wrong[i]).status, expected = Upload(wrong[i]).status;
    EXPECT_FALSE(told.ok()) << i;
    EXPECT_EQ(told.error_code(), expected.error_code()) << i << ": " << told.error_message();
    EXPECT_EQ(told.error_message(), expected.error_message()) << i;
    EXPECT_EQ(told.error_details(), expected.error_details()) << i;
  }
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_)).status.ok());
}

TEST_F(VoxelizeTest, BytesThatAreNoMessageAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto channel = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
  for (const std::string& bytes : {std::string(), std::string("\xff\xff\xff\xff"), std::string("\x0a\xff\x01", 3)}) {
    EXPECT_EQ(SendRawMessages(channel, kVoxelizeMethod, {bytes}).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_)).status.ok());
}

// Lists are estimated: only the end of the run tells whether they fit into one message.
TEST_F(VoxelizeTest, ALargeResultComesInPieces) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    const v1::VoxelizeRequest message = Message(Normals(150, kind), glb_);
    const Received answer = Call(message), upload = Upload(message);
    ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
    EXPECT_EQ(answer.in_one_message, upload.bytes.size() <= 1 << 20);
    EXPECT_EQ(upload.in_one_message, answer.in_one_message);
    EXPECT_TRUE(answer.bytes == upload.bytes);
  }
}

// A slow job reports its progress before its small result.
TEST_F(VoxelizeTest, ASlowJobReportsProgress) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const Received answer = Call(Message(SmallAndSlow(), LargeTrianglesGlb(LessIfSlow(6000))));
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  EXPECT_TRUE(answer.in_one_message);
  EXPECT_GE(answer.stages.size(), 1u);
  EXPECT_EQ(answer.messages, int(answer.stages.size()) + 1);
}

TEST_F(VoxelizeTest, TheClientSendsASmallMeshInOneMessageAndALargeOneInPieces) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  uint64_t sent = 0;
  const auto ask = [&](const std::vector<uint8_t>& mesh, const VoxelizeRequest& request) {
    bool planned = false;
    const auto run = client_->Voxelize(mesh, MeshFormat::kGlb, request, job,
                                       [&](const Plan& plan) { planned = plan.grid.dims[0] > 0; });
    EXPECT_TRUE(run.ok()) << run.status();
    EXPECT_TRUE(planned);
    sent += mesh.size();
  };
  ask(glb_, SmallRequest());
  ask(glb_, Normals(16, ResultKind::kSparse));
  ask(glb_, Normals(100, ResultKind::kDense));
  EXPECT_TRUE(Soon([&] { return Calls("OK") == 3; }));
  const std::vector<uint8_t> large = TorusGlb(200);
  ASSERT_GT(large.size(), size_t{1} << 20);
  ask(large, SmallRequest());
  EXPECT_TRUE(Soon([&] { return Calls("OK", "VoxelizeUpload") == 1; }));
  EXPECT_EQ(Calls("OK"), 3);
  EXPECT_EQ(Sample("voxelpipe_jobs_total{code=\"OK\"}"), 4);
  EXPECT_EQ(Sample("voxelpipe_received_bytes_total"), double(sent));
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
}

// HTTP/2's own window is 64 KiB, and this client never opens it.
TEST_F(VoxelizeTest, AClientThatDoesNotTakeItsAnswerIsLetGo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stall-timeout-ms", "500"}));
  VoxelizeRequest request = Normals(44, ResultKind::kDense);
  request.grid.fit = GridFit::kCube;  // a megabyte
  auto client = RawClient::Connect(server_->address());
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE((*client)->Send("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + http2::Frame(http2::kSettings, 0, 0, "")));
  const std::string message = http2::Message(Message(request, glb_).SerializeAsString());
  ASSERT_TRUE((*client)->Send(http2::Request(1, kVoxelizeMethod) + http2::Data(1, message, true)));
  ASSERT_TRUE((*client)->ReadUntilData());
  EXPECT_TRUE(Soon([&] { return Calls("ABORTED") == 1; }));
  EXPECT_EQ(Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}"), 0);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
}

TEST_F(VoxelizeTest, CancelAndDeadlineEndTheCallAndFreeTheWorker) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const v1::VoxelizeRequest slow = Message(SmallAndSlow(), LargeTrianglesGlb(40000));
  // While it runs, and, behind it, while it waits.
  for (int i = 0; i < 3; ++i) {
    grpc::ClientContext contexts[2];
    std::vector<std::future<grpc::Status>> calls;
    for (grpc::ClientContext& context : contexts) {
      calls.push_back(std::async(std::launch::async, [&] { return Collect(*stub_->Voxelize(&context, slow)).status; }));
    }
    ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") >= 1; }));  // 2 where both come at once
    std::this_thread::sleep_for(std::chrono::milliseconds(20 * i));
    for (grpc::ClientContext& context : contexts) context.TryCancel();
    for (auto& call : calls) EXPECT_EQ(call.get().error_code(), grpc::StatusCode::CANCELLED);
    ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 0; }));
  }
  EXPECT_EQ(Call(slow, std::chrono::milliseconds(300)).status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_)).status.ok());
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}") == 0; }));
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
}

// Equal requests share one run, whether the result is sent in one message or in pieces.
TEST_F(VoxelizeTest, EqualRequestsShareOneRun) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const JobContext job;
  const auto mesh = client_->UploadMesh(LargeTrianglesGlb(LessIfSlow(3000)), MeshFormat::kGlb, job);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  for (const int64_t resolution : {60, 200}) {
    VoxelizeRequest request = SmallAndSlow();
    request.grid.resolution = resolution;
    const v1::VoxelizeRequest message = StoredRequestOf(request, mesh->name);
    std::vector<std::future<Received>> calls;
    for (int i = 0; i < 6; ++i) {
      calls.push_back(std::async(std::launch::async, [&] { return Call(message); }));
    }
    std::string hash;
    for (auto& call : calls) {
      const Received answer = call.get();
      EXPECT_TRUE(answer.status.ok()) << answer.status.error_message();
      EXPECT_EQ(answer.in_one_message, answer.bytes.size() <= 1 << 20);
      if (hash.empty()) hash = answer.summary.content_sha256();
      EXPECT_EQ(answer.summary.content_sha256(), hash);
    }
  }
  EXPECT_GE(Sample("voxelpipe_jobs_shared_total"), 1);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 0; }));
}

TEST_F(VoxelizeTest, AFullQueueAsksToComeAgain) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1", "--max-queue", "1"}));
  BackgroundCall running(*client_, LargeTrianglesGlb(20000), SlowRequest());  // a minute or more
  ASSERT_TRUE(running.WaitUntilPlanned());
  const v1::VoxelizeRequest message = Message(SmallRequest(), glb_);
  grpc::ClientContext context;
  auto waiting = std::async(std::launch::async, [&] { return Collect(*stub_->Voxelize(&context, message)).status; });
  ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_queue_jobs{priority=\"normal\"}") == 1; }));
  const grpc::Status refused = Call(message).status;
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(RetryDelay(FromGrpcStatus(refused)).has_value());
  context.TryCancel();
  EXPECT_EQ(waiting.get().error_code(), grpc::StatusCode::CANCELLED);
  running.Cancel();
  EXPECT_EQ(running.Result().status().code(), absl::StatusCode::kCancelled);
}

TEST_F(VoxelizeTest, ADrainAnswersWhatIsInHandAndTakesNothingElse) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0"}));
  VoxelizeRequest request = SmallAndSlow();
  const v1::VoxelizeRequest message = Message(request, LargeTrianglesGlb(LessIfSlow(500)));
  auto call = std::async(std::launch::async, [&] { return Call(message).status; });
  ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 1 || Calls("OK") == 1; }));
  server_->Signal(SIGTERM);
  EXPECT_TRUE(call.get().ok());
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
  EXPECT_EQ(Call(Message(SmallRequest(), glb_)).status.error_code(), grpc::StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace voxelpipe::testing
