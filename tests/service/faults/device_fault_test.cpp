// A server process whose GPU breaks: in the middle of a batch, for good, for a while, out of memory, without a sign of
// life. "cuda:0" is a device that does the CPU's work and breaks as a file says (support/faulty_backend.h).
#include <signal.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <future>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "gmock/gmock.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/temporary_directory.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using grpc::health::v1::HealthCheckResponse;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// What came of one call.
struct Answer {
  absl::Status status;
  std::string bytes;
  v1::Summary summary;
};

class DeviceFaultTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "error", "--probe-interval-ms", "20", "--max-probe-interval-ms",
                                       "40", "--lame-duck-ms", "10"});
    // As StartServer does, and why.
    setenv("GRPC_CLIENT_CHANNEL_BACKUP_POLL_INTERVAL_MS", "100", /*overwrite=*/0);
    auto server = ServerProcess::StartFaulty(file_, arguments);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    channel_ = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
    stub_ = v1::VoxelizationService::NewStub(channel_);
    health_ = grpc::health::v1::Health::NewStub(channel_);
  }

  // What the device does from now on.
  void Fault(const std::string& text) {
    const std::string draft = file_ + ".new";
    std::ofstream(draft) << text << " change=" << ++changes_;
    ASSERT_EQ(std::rename(draft.c_str(), file_.c_str()), 0);
  }

  v1::VoxelizeRequest Request(v1::Backend backend = v1::BACKEND_CUDA, bool fallback = true) const {
    v1::VoxelizeRequest request;
    request.mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(32);
    request.mutable_execution()->set_backend(backend);
    request.mutable_execution()->set_fallback(fallback);
    SetFile(request, glb_);
    return request;
  }

  Answer Ask(const v1::VoxelizeRequest& request, std::chrono::milliseconds deadline = kPatience) {
    Received received = CallUpload(*stub_, request, deadline);
    return {FromGrpcStatus(received.status), std::move(received.bytes), std::move(received.summary)};
  }

  // As many at the same time.
  std::vector<Answer> AskTogether(int count, const v1::VoxelizeRequest& request) {
    std::vector<std::future<Answer>> calls;
    for (int i = 0; i < count; ++i) {
      calls.push_back(std::async(std::launch::async, [&] { return Ask(request); }));
    }
    std::vector<Answer> answers;
    for (auto& call : calls) answers.push_back(call.get());
    return answers;
  }

  // The bytes of the same request where nothing breaks.
  const Answer& Right() { return Right(Request()); }
  const Answer& Right(const v1::VoxelizeRequest& request) {
    if (!right_) {
      v1::VoxelizeRequest cpu = request;
      cpu.mutable_execution()->set_backend(v1::BACKEND_CPU);
      right_ = Ask(cpu);
      EXPECT_TRUE(right_->status.ok()) << right_->status;
      EXPECT_EQ(right_->summary.stats().worker().substr(0, 4), "cpu/");
    }
    return *right_;
  }

  void ExpectRight(const Answer& answer, const std::string& device, int attempts) {
    ASSERT_TRUE(answer.status.ok()) << answer.status;
    EXPECT_EQ(answer.bytes, Right().bytes);
    EXPECT_EQ(answer.summary.content_sha256(), Right().summary.content_sha256());
    EXPECT_THAT(answer.summary.stats().worker(), StartsWith(device + "/"));
    EXPECT_EQ(answer.summary.stats().attempts(), attempts);
  }

  // What an estimate gives for the mesh's bytes, or for no more than its summary.
  absl::Status Estimate(const v1::VoxelizeRequest& request, bool with_mesh,
                        v1::EstimateVoxelizationResponse& response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    v1::EstimateVoxelizationRequest estimate;
    *estimate.mutable_spec() = request.spec();
    *estimate.mutable_execution() = request.execution();
    if (with_mesh) {
      *estimate.mutable_mesh() = request.mesh();
    } else {
      estimate.mutable_summary()->set_triangles(12);
      estimate.mutable_summary()->set_vertices(8);
      estimate.mutable_summary()->mutable_max()->set_x(1);
    }
    return FromGrpcStatus(stub_->EstimateVoxelization(&context, estimate, &response));
  }
  void ExpectPlans(const v1::VoxelizeRequest& request, v1::Backend backend) {
    for (const bool with_mesh : {true, false}) {
      v1::EstimateVoxelizationResponse response;
      const absl::Status status = Estimate(request, with_mesh, response);
      EXPECT_TRUE(status.ok()) << status;
      EXPECT_EQ(response.plan().backend(), backend) << with_mesh;
    }
  }
  void ExpectNoPlan(const v1::VoxelizeRequest& request, absl::StatusCode code) {
    for (const bool with_mesh : {true, false}) {
      v1::EstimateVoxelizationResponse response;
      const absl::Status status = Estimate(request, with_mesh, response);
      EXPECT_EQ(status.code(), code) << status;
    }
  }
  std::vector<v1::Backend> Backends() {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    v1::GetServerInfoResponse response;
    EXPECT_TRUE(stub_->GetServerInfo(&context, {}, &response).ok());
    std::vector<v1::Backend> backends;
    for (const v1::BackendInfo& backend : response.backends()) backends.push_back(backend.backend());
    return backends;
  }

  HealthCheckResponse::ServingStatus Health(const std::string& name) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    grpc::health::v1::HealthCheckRequest request;
    request.set_service(name);
    HealthCheckResponse response;
    const grpc::Status status = health_->Check(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.status();
  }
  bool WaitForHealth(const std::string& name, HealthCheckResponse::ServingStatus wanted) {
    return WaitUntil([&] { return Health(name) == wanted; });
  }
  static bool WaitUntil(const std::function<bool()>& holds) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!holds()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }

  v1::Device Device(const std::string& name) {
    grpc::ClientContext context;
    v1::GetServerInfoResponse info;
    EXPECT_TRUE(stub_->GetServerInfo(&context, {}, &info).ok());
    for (const v1::Device& device : info.devices()) {
      if (device.name() == name) return device;
    }
    ADD_FAILURE() << "no device " << name;
    return {};
  }

  const std::vector<uint8_t> glb_ = TorusGlb(16);
  const TemporaryDirectory directory_;
  const std::string file_ = directory_ / "faults";
  int changes_ = 0;
  std::unique_ptr<ServerProcess> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
  std::unique_ptr<grpc::health::v1::Health::Stub> health_;
  std::optional<Answer> right_;
};

TEST_F(DeviceFaultTest, AWorkerThatDiesInTheMiddleOfABatchLosesNothing) {
  ASSERT_NO_FATAL_FAILURE(Start({"--gpu-streams", "1"}));
  Right();
  // The first one holds the worker until the others wait together; when it goes on, they break.
  Fault("kind=stall stage=fine_raster runs=1");
  auto first = std::async(std::launch::async, [&] { return Ask(Request()); });
  ASSERT_TRUE(WaitUntil([&] { return Health("") == HealthCheckResponse::SERVING; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  auto others = std::async(std::launch::async, [&] { return AskTogether(12, Request()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  Fault("kind=lost stage=fine_raster runs=-1 probes=1000000");
  ExpectRight(first.get(), "cuda:0", 1);
  for (const Answer& answer : others.get()) {
    ASSERT_TRUE(answer.status.ok()) << answer.status;
    EXPECT_EQ(answer.bytes, Right().bytes);
    EXPECT_THAT(answer.summary.stats().worker(), StartsWith("cpu/"));
    EXPECT_LE(answer.summary.stats().attempts(), 2u);  // 1: it came when the device was in quarantine
  }
}

TEST_F(DeviceFaultTest, ALostDeviceIsToldAndComesBack) {
  ASSERT_NO_FATAL_FAILURE(Start());
  EXPECT_EQ(Health("device/cuda:0"), HealthCheckResponse::SERVING);
  ExpectRight(Ask(Request()), "cuda:0", 1);
  Fault("kind=lost stage=fine_raster runs=1 probes=1000000");
  ExpectRight(Ask(Request()), "cpu", 2);
  EXPECT_EQ(Health("device/cuda:0"), HealthCheckResponse::NOT_SERVING);
  EXPECT_EQ(Health("device/cpu"), HealthCheckResponse::SERVING);
  EXPECT_EQ(Health(""), HealthCheckResponse::SERVING) << "the CPU serves";
  EXPECT_EQ(Device("cuda:0").state(), v1::DEVICE_STATE_QUARANTINED);
  EXPECT_NE(Device("cuda:0").reason(), "");
  ExpectRight(Ask(Request()), "cpu", 1);
  Fault("");
  EXPECT_TRUE(WaitForHealth("device/cuda:0", HealthCheckResponse::SERVING));
  EXPECT_EQ(Device("cuda:0").state(), v1::DEVICE_STATE_SERVING);
  ExpectRight(Ask(Request()), "cuda:0", 1);
}

TEST_F(DeviceFaultTest, WithoutFallbackTheClientHearsOfIt) {
  ASSERT_NO_FATAL_FAILURE(Start());
  Fault("kind=lost stage=fine_raster runs=-1 probes=1000000");
  const v1::VoxelizeRequest strict = Request(v1::BACKEND_CUDA, /*fallback=*/false);
  for (int i = 0; i < 2; ++i) {  // as the one that finds out, and while the device is in quarantine
    const Answer answer = Ask(strict);
    EXPECT_EQ(answer.status.code(), absl::StatusCode::kUnavailable) << answer.status;
    EXPECT_THAT(std::string(answer.status.message()), HasSubstr("cuda:0"));
    EXPECT_TRUE(RetryDelay(answer.status).has_value());
  }
  ExpectRight(Ask(Request(v1::BACKEND_AUTO)), "cpu", 1);
  Fault("");
  ASSERT_TRUE(WaitForHealth("device/cuda:0", HealthCheckResponse::SERVING));
  ExpectRight(Ask(strict), "cuda:0", 1);
}

TEST_F(DeviceFaultTest, AServerWithoutFallbackKeepsJobsWhereTheyAre) {
  ASSERT_NO_FATAL_FAILURE(Start({"--fallback", "off"}));
  Fault("kind=lost stage=fine_raster runs=-1 probes=1000000");
  EXPECT_EQ(Ask(Request()).status.code(), absl::StatusCode::kUnavailable);
  ExpectRight(Ask(Request(v1::BACKEND_CPU)), "cpu", 1);
}

TEST_F(DeviceFaultTest, AGpuThatIsNotUsedIsAPrecondition) {
  ASSERT_NO_FATAL_FAILURE(Start({"--gpus", "none"}));
  const Answer answer = Ask(Request(v1::BACKEND_CUDA, /*fallback=*/false));
  EXPECT_EQ(answer.status.code(), absl::StatusCode::kFailedPrecondition) << answer.status;
  ExpectRight(Ask(Request()), "cpu", 1);
}

// An estimate takes a device of the pool that serves: whatever starts on another fails here.
TEST_F(DeviceFaultTest, EstimatesAndTheServersBackendsKnowWhichGpusAreUsed) {
  Fault("kind=error stage=start runs=-1");
  ASSERT_NO_FATAL_FAILURE(Start({"--gpus", "none"}));
  ExpectPlans(Request(v1::BACKEND_AUTO), v1::BACKEND_CPU);
  ExpectNoPlan(Request(v1::BACKEND_CUDA, /*fallback=*/false), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(Backends(), ::testing::ElementsAre(v1::BACKEND_CPU));
}

TEST_F(DeviceFaultTest, EstimatesKnowThatADeviceIsInQuarantine) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ExpectPlans(Request(v1::BACKEND_AUTO), v1::BACKEND_CUDA);
  Fault("kind=lost stage=fine_raster runs=1 probes=1000000");
  ExpectRight(Ask(Request()), "cpu", 2);
  Fault("kind=error stage=start runs=-1 probes=1000000");
  ExpectPlans(Request(v1::BACKEND_AUTO), v1::BACKEND_CPU);
  ExpectNoPlan(Request(v1::BACKEND_CUDA, /*fallback=*/false), absl::StatusCode::kUnavailable);
  EXPECT_THAT(Backends(), ::testing::ElementsAre(v1::BACKEND_CUDA, v1::BACKEND_CPU)) << "it may come back";
}

TEST_F(DeviceFaultTest, OutOfMemoryIsNotTheEndOfTheDevice) {
  ASSERT_NO_FATAL_FAILURE(Start());
  Fault("kind=memory stage=fine_raster runs=-1");
  ExpectRight(Ask(Request()), "cpu", 2);
  const Answer strict = Ask(Request(v1::BACKEND_CUDA, /*fallback=*/false));
  EXPECT_EQ(strict.status.code(), absl::StatusCode::kResourceExhausted) << strict.status;
  EXPECT_EQ(Health("device/cuda:0"), HealthCheckResponse::SERVING);
  Fault("kind=memory stage=fine_raster runs=5");
  for (const Answer& answer : AskTogether(16, Request())) {
    ASSERT_TRUE(answer.status.ok()) << answer.status;
    EXPECT_EQ(answer.bytes, Right().bytes);
  }
}

TEST_F(DeviceFaultTest, AStalledDeviceIsLostAndDoesNotHoldUpItsJobsOrTheEnd) {
  ASSERT_NO_FATAL_FAILURE(Start({"--device-stall-ms", "1000"}));
  Fault("kind=stall stage=fine_raster runs=1 probe=stall");
  ExpectRight(Ask(Request()), "cpu", 2);
  EXPECT_EQ(Health("device/cuda:0"), HealthCheckResponse::NOT_SERVING);
  // The thread is still stuck, and so is a probe.
  server_->Signal(SIGTERM);
  const auto end = server_->Wait(std::chrono::seconds(20));
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(DeviceFaultTest, ADeviceThatStalledComesBack) {
  ASSERT_NO_FATAL_FAILURE(Start({"--device-stall-ms", "1000"}));
  Fault("kind=stall stage=fine_raster runs=1 probes=1000000");
  ExpectRight(Ask(Request()), "cpu", 2);
  Fault("");
  ASSERT_TRUE(WaitForHealth("device/cuda:0", HealthCheckResponse::SERVING));
  ExpectRight(Ask(Request()), "cuda:0", 1);
}

TEST_F(DeviceFaultTest, TheEndDoesNotWaitForAStalledDeviceForLongerThanItsGrace) {
  ASSERT_NO_FATAL_FAILURE(Start({"--device-stall-ms", "0", "--drain-grace-ms", "200"}));
  Fault("kind=stall stage=fine_raster runs=1");
  auto call = std::async(std::launch::async, [&] { return Ask(Request()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  server_->Signal(SIGTERM);
  const auto end = server_->Wait(std::chrono::seconds(20));
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
  EXPECT_FALSE(call.get().status.ok());
}

TEST_F(DeviceFaultTest, TheEndComesInTimeWhileADeviceIsInQuarantine) {
  ASSERT_NO_FATAL_FAILURE(Start());
  Fault("kind=lost stage=fine_raster runs=1 probes=1000000");
  ExpectRight(Ask(Request()), "cpu", 2);
  server_->Signal(SIGTERM);
  const auto end = server_->Wait(std::chrono::seconds(20));
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(DeviceFaultTest, AStreamedResultGoesOnAfterTheFailure) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "1"}));
  v1::VoxelizeRequest request = Request();
  request.mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(
      384);  // 1.9 MiB of bits and more than one slab
  const Answer right = Right(request);
  ASSERT_GT(right.bytes.size(), size_t{1} << 20);
  for (const char* slab : {"0", "1"}) {
    Fault(std::string("kind=lost stage=fine_raster runs=1 slab=") + slab);
    ASSERT_TRUE(WaitForHealth("device/cuda:0", HealthCheckResponse::SERVING));
    ExpectRight(Ask(request), "cpu", 2);
  }
}

TEST_F(DeviceFaultTest, WithEveryDeviceLostTheServerIsNotReadyAndRecovers) {
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cuda", "--fallback", "off"}));
  Fault("kind=lost stage=fine_raster runs=-1 probes=1000000");
  const Answer failed = Ask(Request());
  EXPECT_EQ(failed.status.code(), absl::StatusCode::kUnavailable) << failed.status;
  EXPECT_EQ(Health(""), HealthCheckResponse::NOT_SERVING);
  EXPECT_EQ(Health("voxelpipe.v1.VoxelizationService"), HealthCheckResponse::NOT_SERVING);
  const Answer refused = Ask(Request(v1::BACKEND_AUTO));
  EXPECT_EQ(refused.status.code(), absl::StatusCode::kUnavailable) << refused.status;
  EXPECT_THAT(std::string(refused.status.message()), HasSubstr("quarantined"));
  Fault("");
  EXPECT_TRUE(WaitForHealth("", HealthCheckResponse::SERVING));
  const Answer recovered = Ask(Request());
  ASSERT_TRUE(recovered.status.ok()) << recovered.status;
  EXPECT_THAT(recovered.summary.stats().worker(), StartsWith("cuda:0/"));
}

TEST_F(DeviceFaultTest, AFailureAtEveryStageIsMadeGood) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (const char* stage : {"start", "vertex_shade", "coarse_raster", "begin_slab", "fine_raster", "finish"}) {
    for (const char* kind : {"error", "lost", "memory"}) {
      Fault(std::string("runs=1 kind=") + kind + " stage=" + stage);
      ASSERT_TRUE(WaitForHealth("device/cuda:0", HealthCheckResponse::SERVING));
      const Answer answer = Ask(Request());
      SCOPED_TRACE(std::string(kind) + " in " + stage);
      ExpectRight(answer, "cpu", 2);
    }
  }
}

}  // namespace
}  // namespace voxelpipe::testing
