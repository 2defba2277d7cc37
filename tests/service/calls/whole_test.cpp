// One message in, one small result out: the same as on a stream, in bytes, errors and rules.
#include <signal.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/server_builder.h>

#include "base/checksum/crc32c.h"
#include "gmock/gmock.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/http_get.h"
#include "service/support/raw_client.h"
#include "service/support/raw_messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

constexpr char kMethod[] = "/voxelpipe.v1.VoxelizationService/VoxelizeWhole";

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

// Error details that can be compared: the order of a map on the wire is anyone's.
std::string Details(const grpc::Status& status) {
  google::rpc::Status all;
  EXPECT_TRUE(all.ParseFromString(status.error_details()));
  std::string text = std::to_string(all.code()) + " " + all.message();
  for (const google::protobuf::Any& detail : all.details()) {
    google::rpc::ErrorInfo info;
    text += "\n" + detail.type_url() + " ";
    text += detail.UnpackTo(&info) ? info.DebugString() : detail.value();
  }
  return text;
}

class WholeTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn", "--http-listen", "127.0.0.1:0"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    stub_ =
        v1::VoxelizationService::NewStub(grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials()));
  }

  static v1::VoxelizeWholeRequest Message(const VoxelizeRequest& request, const std::vector<uint8_t>& mesh) {
    v1::VoxelizeWholeRequest message;
    *message.mutable_config() = MakeConfig(request, MeshFormat::kAuto);
    message.set_mesh(mesh.data(), mesh.size());
    return message;
  }

  grpc::Status Call(const v1::VoxelizeWholeRequest& message, v1::VoxelizeWholeResponse& response,
                    std::chrono::milliseconds timeout = kPatience) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout);
    return stub_->VoxelizeWhole(&context, message, &response);
  }
  grpc::Status Call(const v1::VoxelizeWholeRequest& message) {
    v1::VoxelizeWholeResponse response;
    return Call(message, response);
  }

  struct OnStream {
    std::string bytes;
    v1::Summary summary;
    grpc::Status status;
  };
  // The same job on a stream: config, then the mesh in one piece.
  OnStream Stream(const v1::VoxelizeWholeRequest& like) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->Voxelize(&context);
    v1::VoxelizeRequest message;
    *message.mutable_config() = like.config();
    bool open = stream->Write(message);
    message.set_mesh_piece(like.mesh());
    if (like.has_crc32c()) message.set_crc32c(like.crc32c());
    if (open && !like.mesh().empty()) open = stream->Write(message);
    stream->WritesDone();
    OnStream out;
    v1::VoxelizeResponse response;
    while (stream->Read(&response)) {
      if (response.has_piece()) out.bytes += response.piece().data();
      if (response.has_summary()) out.summary = response.summary();
    }
    out.status = stream->Finish();
    return out;
  }

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
  double Calls(const std::string& code, const std::string& method = "VoxelizeWhole") {
    return Sample("voxelpipe_calls_total{code=\"" + code + "\",method=\"" + method + "\"}");
  }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

TEST_F(WholeTest, TheBytesAreThoseOfAStream) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<VoxelizeRequest> requests;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const int64_t resolution : {1, 9, 33}) {
      requests.push_back(Normals(resolution, kind));
      requests.push_back(requests.back());
      requests.back().targets = VoxelizeRequest().targets;
    }
  }
  for (const VoxelizeRequest& request : requests) {
    const v1::VoxelizeWholeRequest message = Message(request, glb_);
    v1::VoxelizeWholeResponse response;
    const grpc::Status status = Call(message, response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    const v1::WholeResult& whole = response.result();
    std::string bytes;
    for (const v1::ResultPiece& piece : whole.pieces()) {
      EXPECT_EQ(piece.crc32c(), Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size()}));
      bytes += piece.data();
    }
    const OnStream stream = Stream(message);
    ASSERT_TRUE(stream.status.ok()) << stream.status.error_message();
    EXPECT_TRUE(bytes == stream.bytes);
    EXPECT_EQ(whole.summary().content_sha256(), stream.summary.content_sha256());
    EXPECT_EQ(whole.summary().result_bytes(), stream.bytes.size());
    EXPECT_EQ(whole.summary().stats().triangles(), 128u);
    EXPECT_EQ(whole.header().grid().dims().SerializeAsString(), whole.accepted().grid().dims().SerializeAsString());
  }
}

TEST_F(WholeTest, SmallSlabsAreGathered) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "0"}));
  const v1::VoxelizeWholeRequest message = Message(Normals(40, ResultKind::kDense), glb_);
  v1::VoxelizeWholeResponse response;
  const grpc::Status status = Call(message, response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_LT(response.result().accepted().slab_depth(), response.result().accepted().grid().dims().z());
  EXPECT_EQ(response.result().summary().content_sha256(), Stream(message).summary.content_sha256());
}

TEST_F(WholeTest, AStoredMeshCompressionAndNoHashAreAsOnAStream) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16MiB"}));
  const JobContext job;
  const auto mesh = client_->UploadMesh(glb_, MeshFormat::kGlb, job);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  v1::VoxelizeWholeRequest message = Message(Normals(20, ResultKind::kDense), {});
  message.mutable_config()->set_mesh_id(mesh->mesh_id);
  v1::VoxelizeWholeResponse first, again, packed, bare;
  ASSERT_TRUE(Call(message, first).ok());
  ASSERT_TRUE(Call(message, again).ok());
  EXPECT_FALSE(first.result().summary().cached());
  EXPECT_TRUE(again.result().summary().cached());
  message.mutable_config()->set_compression(v1::COMPRESSION_ZSTD);
  ASSERT_TRUE(Call(message, packed).ok());
  EXPECT_LT(packed.result().summary().sent_bytes(), packed.result().summary().result_bytes());
  EXPECT_EQ(packed.result().summary().content_sha256(), Stream(message).summary.content_sha256());
  message.mutable_config()->set_compression(v1::COMPRESSION_NONE);
  message.mutable_config()->set_without_content_hash(true);
  ASSERT_TRUE(Call(message, bare).ok());
  EXPECT_EQ(bare.result().summary().content_sha256(), "");
  EXPECT_EQ(bare.result().pieces(0).data(), first.result().pieces(0).data());
  EXPECT_EQ(first.result().summary().content_sha256(), again.result().summary().content_sha256());
}

TEST_F(WholeTest, EveryErrorIsThatOfAStream) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-result-bytes", "2000000", "--max-file-bytes", "1048576"}));
  std::vector<v1::VoxelizeWholeRequest> wrong(10, Message(SmallRequest(), glb_));
  wrong[0].mutable_config()->mutable_targets(0)->mutable_shader()->set_name("nothing");
  wrong[1].mutable_config()->mutable_grid()->set_resolution(-1);
  wrong[2].mutable_config()->mutable_grid()->set_resolution(1024);  // beyond the server's limit
  wrong[3].mutable_config()->set_mesh_id(std::string(64, 'a'));
  wrong[4].mutable_config()->set_mesh_id("no id");
  wrong[5].set_mesh("no mesh at all");
  wrong[6].set_mesh("");
  wrong[7].set_crc32c(1);
  wrong[8].mutable_config()->set_backend(v1::BACKEND_CUDA);
  wrong[9].set_mesh(std::string((1 << 20) + 1, ' '));
  if (Stream(wrong[8]).status.ok()) wrong[8].mutable_config()->set_backend(v1::Backend(99));  // it has a GPU
  for (size_t i = 0; i < wrong.size(); ++i) {
    const grpc::Status told = Call(wrong[i]), expected = Stream(wrong[i]).status;
    EXPECT_FALSE(told.ok()) << i;
    EXPECT_EQ(told.error_code(), expected.error_code()) << i << ": " << told.error_message();
    EXPECT_EQ(told.error_message(), expected.error_message()) << i;
    EXPECT_EQ(Details(told), Details(expected)) << i;
  }
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_)).ok());
}

TEST_F(WholeTest, BytesThatAreNoMessageAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto channel = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
  for (const std::string& bytes : {std::string(), std::string("\xff\xff\xff\xff"), std::string("\x0a\xff\x01", 3)}) {
    EXPECT_EQ(SendRawMessages(channel, kMethod, {bytes}).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_)).ok());
}

TEST_F(WholeTest, WhatIsTooLargeIsRefusedBeforeTheWorkAndTheClientStreamsIt) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kBuckets}) {
    const VoxelizeRequest request = Normals(150, kind);
    const grpc::Status status = Call(Message(request, glb_));
    EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("1048576"));
    EXPECT_THAT(status.error_message(), HasSubstr("Voxelize streams it"));
    EXPECT_TRUE(NeedsStream(FromGrpcStatus(status)));
  }
  EXPECT_EQ(Sample("voxelpipe_stage_seconds_count{stage=\"fine_raster\"}"), 0) << "the work was done";
  const JobContext job;
  const auto large = client_->Voxelize(glb_, MeshFormat::kGlb, Normals(150, ResultKind::kDense), job);
  EXPECT_TRUE(large.ok()) << large.status();
  EXPECT_TRUE(Soon([&] { return Calls("OK", "Voxelize") == 1; }));
}

// The client knows the size of what it asks for; what it does not know goes on a stream at once.
TEST_F(WholeTest, TheClientTakesTheCallThatFits) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  const auto ask = [&](const VoxelizeRequest& request) {
    bool planned = false;
    const auto run = client_->Voxelize(glb_, MeshFormat::kGlb, request, job,
                                       [&](const Plan& plan) { planned = plan.grid.dims[0] > 0; });
    EXPECT_TRUE(run.ok()) << run.status();
    EXPECT_TRUE(planned);
  };
  ask(SmallRequest());
  EXPECT_TRUE(Soon([&] { return Calls("OK") == 1; }));
  ask(Normals(16, ResultKind::kSparse));
  ask(Normals(100, ResultKind::kDense));
  EXPECT_TRUE(Soon([&] { return Calls("OK", "Voxelize") == 2; }));
  EXPECT_EQ(Calls("OK"), 1);
  EXPECT_EQ(Sample("voxelpipe_jobs_total{code=\"OK\"}"), 3);
  EXPECT_EQ(Sample("voxelpipe_received_bytes_total"), 3 * double(glb_.size()));
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
}

// A server of before VoxelizeWhole, which has another one do the work.
class OlderServer final : public v1::VoxelizationService::Service {
 public:
  explicit OlderServer(v1::VoxelizationService::Stub& behind) : behind_(behind) {}

  grpc::Status VoxelizeWhole(grpc::ServerContext* /*context*/, const v1::VoxelizeWholeRequest* /*request*/,
                             v1::VoxelizeWholeResponse* /*response*/) override {
    ++asked;
    return {grpc::StatusCode::UNIMPLEMENTED, "as of a method that is not there"};
  }
  grpc::Status Voxelize(grpc::ServerContext* /*context*/,
                        grpc::ServerReaderWriter<v1::VoxelizeResponse, v1::VoxelizeRequest>* stream) override {
    grpc::ClientContext context;
    const auto call = behind_.Voxelize(&context);
    v1::VoxelizeRequest request;
    while (stream->Read(&request)) call->Write(request);
    call->WritesDone();
    v1::VoxelizeResponse response;
    while (call->Read(&response)) stream->Write(response);
    return call->Finish();
  }

  std::atomic<int> asked{0};

 private:
  v1::VoxelizationService::Stub& behind_;
};

TEST_F(WholeTest, AnOlderServerIsAskedOnceAndThenOnStreams) {
  ASSERT_NO_FATAL_FAILURE(Start());
  OlderServer older(*stub_);
  int port = 0;
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
  builder.RegisterService(&older);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  ASSERT_NE(server, nullptr);
  const auto client = Client::Connect("127.0.0.1:" + std::to_string(port));
  ASSERT_TRUE(client.ok()) << client.status();
  const JobContext job;
  for (int i = 0; i < 3; ++i) {
    const auto result = (*client)->Voxelize(glb_, MeshFormat::kGlb, SmallRequest(), job);
    EXPECT_TRUE(result.ok()) << result.status();
  }
  EXPECT_EQ(older.asked, 1);
  EXPECT_TRUE(Soon([&] { return Calls("OK", "Voxelize") == 3; }));
}

// HTTP/2's own window is 64 KiB, and this client never opens it.
TEST_F(WholeTest, AClientThatDoesNotTakeItsAnswerIsLetGo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stall-timeout-ms", "500"}));
  VoxelizeRequest request = Normals(44, ResultKind::kDense);
  request.grid.fit = GridFit::kCube;  // a megabyte
  auto client = RawClient::Connect(server_->address());
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE((*client)->Send("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + http2::Frame(http2::kSettings, 0, 0, "")));
  const std::string message = http2::Message(Message(request, glb_).SerializeAsString());
  ASSERT_TRUE((*client)->Send(http2::Request(1, kMethod) + http2::Data(1, message, true)));
  ASSERT_TRUE((*client)->ReadUntilData());
  EXPECT_TRUE(Soon([&] { return Calls("ABORTED") == 1; }));
  EXPECT_EQ(Sample("voxelpipe_calls_in_flight{method=\"VoxelizeWhole\"}"), 0);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
}

// A small result of a lot of work, which keeps the one worker.
VoxelizeRequest SmallAndSlow() {
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 60;
  return request;
}

TEST_F(WholeTest, CancelAndDeadlineEndTheCallAndFreeTheWorker) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const v1::VoxelizeWholeRequest slow = Message(SmallAndSlow(), LargeTrianglesGlb(40000));
  v1::VoxelizeWholeResponse response;
  // While it runs, and, behind it, while it waits.
  for (int i = 0; i < 3; ++i) {
    grpc::ClientContext contexts[2];
    std::vector<std::future<grpc::Status>> calls;
    for (grpc::ClientContext& context : contexts) {
      calls.push_back(std::async(std::launch::async, [&] {
        v1::VoxelizeWholeResponse none;
        return stub_->VoxelizeWhole(&context, slow, &none);
      }));
    }
    ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") >= 1; }));  // 2 where both come at once
    std::this_thread::sleep_for(std::chrono::milliseconds(20 * i));
    for (grpc::ClientContext& context : contexts) context.TryCancel();
    for (auto& call : calls) EXPECT_EQ(call.get().error_code(), grpc::StatusCode::CANCELLED);
    ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 0; }));
  }
  EXPECT_EQ(Call(slow, response, std::chrono::milliseconds(300)).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(Call(Message(SmallRequest(), glb_), response).ok());
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_calls_in_flight{method=\"VoxelizeWhole\"}") == 0; }));
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
}

// Equal requests share one run: a cancelled one does not affect the others, and all get the error of a result too large
// for one message.
TEST_F(WholeTest, EqualRequestsShareOneRun) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1"}));
  const JobContext job;
  const auto mesh = client_->UploadMesh(LargeTrianglesGlb(LessIfSlow(3000)), MeshFormat::kGlb, job);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  for (const int64_t resolution : {60, 200}) {
    VoxelizeRequest request = SmallAndSlow();
    request.grid.resolution = resolution;
    v1::VoxelizeWholeRequest message = Message(request, {});
    message.mutable_config()->set_mesh_id(mesh->mesh_id);
    std::vector<std::future<grpc::Status>> calls;
    for (int i = 0; i < 6; ++i) {
      calls.push_back(std::async(std::launch::async, [&] { return Call(message); }));
    }
    for (auto& call : calls) EXPECT_EQ(call.get().ok(), resolution == 60);
  }
  EXPECT_GE(Sample("voxelpipe_jobs_shared_total"), 1);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 0; }));
}

TEST_F(WholeTest, AFullQueueAsksToComeAgain) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--threads", "1", "--max-queue", "1"}));
  BackgroundCall running(*client_, LargeTrianglesGlb(20000), SlowRequest());  // a minute or more
  ASSERT_TRUE(running.WaitUntilPlanned());
  const v1::VoxelizeWholeRequest message = Message(SmallRequest(), glb_);
  grpc::ClientContext context;
  auto waiting = std::async(std::launch::async, [&] {
    v1::VoxelizeWholeResponse none;
    return stub_->VoxelizeWhole(&context, message, &none);
  });
  ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_queue_jobs{priority=\"normal\"}") == 1; }));
  const grpc::Status refused = Call(message);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(RetryDelay(FromGrpcStatus(refused)).has_value());
  context.TryCancel();
  EXPECT_EQ(waiting.get().error_code(), grpc::StatusCode::CANCELLED);
  running.Cancel();
  EXPECT_EQ(running.Result().status().code(), absl::StatusCode::kCancelled);
}

TEST_F(WholeTest, ADrainAnswersWhatIsInHandAndTakesNothingElse) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0"}));
  VoxelizeRequest request = SmallAndSlow();
  const v1::VoxelizeWholeRequest message = Message(request, LargeTrianglesGlb(LessIfSlow(500)));
  auto call = std::async(std::launch::async, [&] { return Call(message); });
  ASSERT_TRUE(Soon([&] { return Sample("voxelpipe_running_jobs") == 1 || Calls("OK") == 1; }));
  server_->Signal(SIGTERM);
  EXPECT_TRUE(call.get().ok());
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
  EXPECT_EQ(Call(Message(SmallRequest(), glb_)).error_code(), grpc::StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace voxelpipe::testing
