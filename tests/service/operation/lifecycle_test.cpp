// A server from its first line to its last: what orchestrators and operators rely on.
#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <future>
#include <iterator>
#include <string>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "gmock/gmock.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "grpc/reflection/v1alpha/reflection.grpc.pb.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "mesh/report.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/closed_port.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe::testing {
namespace {

using grpc::health::v1::Health;
using grpc::health::v1::HealthCheckRequest;
using grpc::health::v1::HealthCheckResponse;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

constexpr char kServiceName[] = "voxelpipe.v1.VoxelizationService";

class LifecycleTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    channel_ = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
    health_ = Health::NewStub(channel_);
  }

  grpc::Status Check(const std::string& service, HealthCheckResponse& response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    HealthCheckRequest request;
    request.set_service(service);
    return health_->Check(&context, request, &response);
  }

  void ExpectCleanEnd() {
    const absl::StatusOr<CommandResult> end = server_->Wait();
    ASSERT_TRUE(end.ok()) << end.status();
    EXPECT_EQ(end->exit_code, 0);
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<Health::Stub> health_;
};

TEST_F(LifecycleTest, SaysOneLineAndEndsOnSigterm) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  ASSERT_TRUE(client_->Voxelize(TorusGlb(6), MeshFormat::kGlb, SmallRequest(), job).ok());
  server_->Signal(SIGTERM);
  const absl::StatusOr<CommandResult> end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
  EXPECT_EQ(std::count(end->output.begin(), end->output.end(), '\n'), 1) << end->output;
  EXPECT_THAT(end->output, HasSubstr("listening on " + server_->address() + "\n"));
}

TEST_F(LifecycleTest, EndsOnInterruptToo) {
  ASSERT_NO_FATAL_FAILURE(Start());
  server_->Signal(SIGINT);
  ExpectCleanEnd();
}

TEST_F(LifecycleTest, HealthCheck) {
  ASSERT_NO_FATAL_FAILURE(Start());
  HealthCheckResponse response;
  for (const char* service : {"", kServiceName}) {
    ASSERT_TRUE(Check(service, response).ok());
    EXPECT_EQ(response.status(), HealthCheckResponse::SERVING) << service;
  }
  EXPECT_EQ(Check("no.such.Service", response).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_TRUE(client_->CheckHealth().ok());
}

TEST_F(LifecycleTest, HealthWatchSeesTheDrain) {
  // The lame duck time is the time in which calls still come in: long enough here for one.
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "3000"}));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  HealthCheckRequest request;
  request.set_service(kServiceName);
  const auto watch = health_->Watch(&context, request);
  HealthCheckResponse response;
  ASSERT_TRUE(watch->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::SERVING);
  server_->Signal(SIGTERM);
  ASSERT_TRUE(watch->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::NOT_SERVING);

  EXPECT_EQ(client_->CheckHealth().code(), absl::StatusCode::kUnavailable);
  const JobContext job;
  const absl::Status late = client_->Voxelize(TorusGlb(6), MeshFormat::kGlb, SmallRequest(), job).status();
  EXPECT_TRUE(late.ok()) << "a call that comes while the server drains is lost: " << late;

  while (watch->Read(&response)) {}
  watch->Finish();
  ExpectCleanEnd();
}

TEST_F(LifecycleTest, HealthWatchOfAnUnknownService) {
  ASSERT_NO_FATAL_FAILURE(Start());
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  HealthCheckRequest request;
  request.set_service("no.such.Service");
  const auto watch = health_->Watch(&context, request);
  HealthCheckResponse response;
  ASSERT_TRUE(watch->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::SERVICE_UNKNOWN);
}

TEST_F(LifecycleTest, SigtermLetsARunningRequestFinish) {
  const std::string grace_ms = std::to_string(30'000 * kSlowdown);
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0", "--drain-grace-ms", grace_ms, "--threads", "1"}));
  BackgroundCall call(*client_, LargeTrianglesGlb(LessIfSlow(1000)), SlowRequest());
  ASSERT_TRUE(call.WaitUntilPlanned());
  EXPECT_FALSE(call.IsOver());
  server_->Signal(SIGTERM);
  const absl::StatusOr<RemoteResult> result = call.Result();
  EXPECT_TRUE(result.ok()) << result.status();
  ExpectCleanEnd();
}

// A connection that closes under a client which still reads takes the rest of the result with it.
TEST_F(LifecycleTest, SigtermDuringDownloads) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0"}));
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 192;
  std::vector<std::unique_ptr<Client>> clients;
  std::vector<std::unique_ptr<BackgroundCall>> calls;
  for (int i = 0; i < 3; ++i) {
    clients.push_back(ConnectTo(*server_));
    ASSERT_NE(clients.back(), nullptr);
    calls.push_back(std::make_unique<BackgroundCall>(*clients.back(), LargeTrianglesGlb(8), request));
  }
  ASSERT_TRUE(calls[0]->WaitFor("download"));
  for (const auto& call : calls) ASSERT_TRUE(call->WaitUntilPlanned());
  server_->Signal(SIGTERM);
  for (const auto& call : calls) {
    const absl::StatusOr<RemoteResult> result = call->Result();
    EXPECT_TRUE(result.ok()) << result.status();
  }
  ExpectCleanEnd();
}

TEST_F(LifecycleTest, TheDrainHasAnEnd) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0", "--drain-grace-ms", "300", "--threads", "1"}));
  BackgroundCall call(*client_, LargeTrianglesGlb(20000), SlowRequest());
  ASSERT_TRUE(call.WaitUntilPlanned());
  server_->Signal(SIGTERM);
  const absl::Status status = call.Result().status();
  EXPECT_TRUE(status.code() == absl::StatusCode::kUnavailable || status.code() == absl::StatusCode::kCancelled)
      << status;
  ExpectCleanEnd();
}

TEST_F(LifecycleTest, ReflectionListsEveryService) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto stub = grpc::reflection::v1alpha::ServerReflection::NewStub(channel_);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub->ServerReflectionInfo(&context);
  grpc::reflection::v1alpha::ServerReflectionRequest request;
  request.set_list_services("*");
  ASSERT_TRUE(stream->Write(request));
  grpc::reflection::v1alpha::ServerReflectionResponse response;
  ASSERT_TRUE(stream->Read(&response));
  std::vector<std::string> names;
  for (const auto& service : response.list_services_response().service()) names.push_back(service.name());
  EXPECT_THAT(names, Contains(kServiceName));
  EXPECT_THAT(names, Contains("grpc.health.v1.Health"));

  for (const char* method : {".Voxelize", ".VoxelizeBatch", ".VoxelizeUpload"}) {
    request.set_file_containing_symbol(std::string(kServiceName) + method);
    ASSERT_TRUE(stream->Write(request));
    ASSERT_TRUE(stream->Read(&response));
    EXPECT_GE(response.file_descriptor_response().file_descriptor_proto_size(), 1) << method;
  }
  stream->WritesDone();
  stream->Finish();
}

TEST_F(LifecycleTest, Probe) {
  ASSERT_NO_FATAL_FAILURE(Start());
  absl::StatusOr<CommandResult> probe = RunVoxelpiped({"--probe", server_->address()});
  ASSERT_TRUE(probe.ok()) << probe.status();
  EXPECT_EQ(probe->exit_code, 0);
  // A proxy for the way out is set in many containers.
  const ClosedPort closed_port;
  setenv("http_proxy", ("http://" + closed_port.address()).c_str(), /*overwrite=*/1);
  probe = RunVoxelpiped({"--probe", server_->address()});
  unsetenv("http_proxy");
  ASSERT_TRUE(probe.ok()) << probe.status();
  EXPECT_EQ(probe->exit_code, 0) << "the probe went to the proxy";
  probe = RunVoxelpiped({"--probe", closed_port.address()});
  ASSERT_TRUE(probe.ok()) << probe.status();
  EXPECT_EQ(probe->exit_code, 1);
}

TEST_F(LifecycleTest, OptionsThatAreWrong) {
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"--no-such-option"}, {"--backend", "abacus"}, {"--max-queue", "minus one"}}) {
    const absl::StatusOr<CommandResult> run = RunVoxelpiped(arguments);
    ASSERT_TRUE(run.ok()) << run.status();
    EXPECT_EQ(run->exit_code, 2) << arguments[0];
    EXPECT_EQ(run->output, "");
  }
  const absl::StatusOr<CommandResult> version = RunVoxelpiped({"--version"});
  ASSERT_TRUE(version.ok()) << version.status();
  EXPECT_EQ(version->exit_code, 0);
  EXPECT_THAT(version->output, HasSubstr("0.1.0"));
}

TEST_F(LifecycleTest, APortThatIsTaken) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const absl::StatusOr<CommandResult> second = RunVoxelpiped({"--listen", server_->address()});
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(second->exit_code, 1);
  const TemporaryDirectory directory;
  const std::string log = directory / "log";
  EXPECT_FALSE(ServerProcess::Start({"--listen", server_->address()}, log).ok());
  std::ifstream said(log);
  const std::string text{std::istreambuf_iterator<char>(said), {}};
  EXPECT_THAT(text, HasSubstr("cannot listen on " + server_->address() + ": Address already in use"));
}

// gRPC by itself would remove the socket of the first, listen there, and remove it again at its end.
TEST_F(LifecycleTest, ASocketThatIsTakenIsLeftToItsServer) {
  const TemporaryDirectory directory;
  const std::string path = directory / "socket", address = "unix:" + path;
  const auto call = [&](const std::string& to) {
    const auto client = Client::Connect(to);
    return client.ok() ? (*client)->ServerInfo().status() : client.status();
  };
  auto first = StartServer({"--listen", address, "--log-level", "warn"});
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->address(), address);
  const std::string log = directory / "log";
  const auto second = ServerProcess::Start({"--listen", address}, log);
  EXPECT_FALSE(second.ok());
  std::ifstream said(log);
  const std::string text{std::istreambuf_iterator<char>(said), {}};
  EXPECT_THAT(text, HasSubstr("cannot listen on " + address + ": a server listens there"));
  EXPECT_TRUE(call(address).ok());
  // A killed server leaves its socket, which the next one replaces.
  first->Signal(SIGKILL);
  ASSERT_TRUE(first->Wait().ok());
  EXPECT_TRUE(std::filesystem::is_socket(path));
  first = StartServer({"--listen", address, "--log-level", "warn"});
  ASSERT_NE(first, nullptr);
  EXPECT_TRUE(call(address).ok());
  // Another server took the path after someone had removed the socket: it is not the first one's to remove.
  std::filesystem::remove(path);
  auto third = StartServer({"--listen", address, "--log-level", "warn"});
  ASSERT_NE(third, nullptr);
  first->Signal(SIGTERM);
  ASSERT_TRUE(first->Wait().ok());
  EXPECT_TRUE(call(address).ok());
  third->Signal(SIGTERM);
  ASSERT_TRUE(third->Wait().ok());
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(directory.FileCount(), 1u) << "the log, and nothing else";
}

TEST_F(LifecycleTest, ServerInfo) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--loaders", "3", "--max-queue", "17", "--max-file-bytes", "1234567", "--threads", "2"}));
  const absl::StatusOr<ServerDescription> info = client_->ServerInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_THAT(info->version, MatchesRegex("[0-9]+\\.[0-9]+\\.[0-9]+"));
  ASSERT_FALSE(info->backends.empty());
  EXPECT_EQ(info->backends.back().name, "cpu");
  EXPECT_FALSE(info->backends.back().simd.empty());
  EXPECT_EQ(info->workers, 3u);
  EXPECT_EQ(info->max_queue, 17u);
  EXPECT_EQ(info->max_file_bytes, 1234567u);
  EXPECT_EQ(info->threads, 2u);
  EXPECT_GT(info->max_result_bytes, 0u);
  EXPECT_GT(info->max_working_bytes, 0u);
  EXPECT_GT(info->max_triangles, 0u);
}

TEST_F(LifecycleTest, EstimateIsWhatComes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::vector<uint8_t> glb = TorusGlb(20);
  const absl::StatusOr<Scene> scene = LoadScene(glb);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  const MeshReport facts = *ReportMesh({}, *mesh);
  Box3d box;
  box.min = facts.min;
  box.max = facts.max;
  box.empty = false;

  for (int64_t resolution : {1, 16, 77}) {
    for (Fill fill : {Fill::kNone, Fill::kParity}) {
      VoxelizeRequest request;
      request.grid.resolution = resolution;
      request.grid.padding = 2;
      request.fill = fill;
      request.targets.resize(2);
      request.targets[1].format = VoxelFormat::kF32;
      request.targets[1].components = 3;
      request.targets[1].blend = Blend::kMin;
      const JobContext job;
      const absl::StatusOr<Client::Estimated> estimate = client_->Estimate(glb, MeshFormat::kAuto, request, job);
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      const absl::StatusOr<Plan> by_summary =
          client_->Estimate(mesh->triangles.size(), mesh->positions.size(), box, request, job);
      ASSERT_TRUE(by_summary.ok()) << by_summary.status();
      Plan told;
      const absl::StatusOr<RemoteResult> actual =
          client_->Voxelize(glb, MeshFormat::kAuto, request, job, [&](const Plan& plan) { told = plan; });
      ASSERT_TRUE(actual.ok()) << actual.status();

      uint64_t bytes = 0;
      for (const HostBuffer& target : actual->result.targets) bytes += target.size();
      for (const Plan& plan : {estimate->plan, *by_summary, told}) {
        EXPECT_EQ(plan.grid, actual->result.grid);
        EXPECT_EQ(plan.result_bytes, bytes);
        EXPECT_GE(plan.peak_bytes, bytes);
        EXPECT_EQ(plan.backend, actual->result.stats.backend);
      }
      EXPECT_EQ(estimate->plan.peak_bytes, told.peak_bytes);
      EXPECT_EQ(estimate->report.triangles, actual->result.stats.triangles);
    }
  }
}

TEST_F(LifecycleTest, SummaryTellsStagesPeakAndMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.fill = Fill::kParity;
  request.grid.resolution = 512;  // more than goes in one message, which has no room for progress
  std::vector<std::string> reported;
  const JobContext job([&](std::string_view stage, double fraction) {
    EXPECT_GE(fraction, 0);
    EXPECT_LE(fraction, 1);
    reported.emplace_back(stage);
  });
  const absl::StatusOr<RemoteResult> result = client_->Voxelize(TorusGlb(12), MeshFormat::kGlb, request, job);
  ASSERT_TRUE(result.ok()) << result.status();
  std::vector<std::string> stages;
  for (const auto& [stage, ms] : result->result.stats.stages) {
    EXPECT_GE(ms, 0);
    stages.push_back(stage);
  }
  EXPECT_EQ(stages, (std::vector<std::string>{"vertex_shade", "plan", "fine_raster", "fill"}));
  ASSERT_EQ(result->mesh_stages.size(), 2u);
  EXPECT_EQ(result->mesh_stages[0].first, "load");
  EXPECT_EQ(result->mesh_stages[1].first, "flatten");
  EXPECT_GT(result->peak_bytes, 0u);
  EXPECT_EQ(result->report.triangles, 288u);
  EXPECT_EQ(result->report.open_edges, 0u) << "the seams weld";
  EXPECT_LT(result->report.min.x, result->report.max.x);
  EXPECT_THAT(reported, Contains("upload"));
  EXPECT_THAT(reported, Contains("fine_raster"));
  EXPECT_THAT(reported, Contains("download"));
}

}  // namespace
}  // namespace voxelpipe::testing
