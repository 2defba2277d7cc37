// Every metric moves when what it counts happens. Those of single calls stand in observe_test, of certificates and
// tokens in access_test, of sharing in batch_sharing_test.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/background_call.h"
#include "service/support/http_get.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe::testing {
namespace {

class MetricsPathTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments, const std::string& token = "") {
    arguments.insert(arguments.end(), {"--log-level", "off", "--http-listen", "127.0.0.1:0"});
    auto server = ServerProcess::StartFaulty(faults_, arguments);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    const auto http = server_->http_address();
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *http;
    token_ = token;
    client_ = ClientWith({});
    ASSERT_NE(client_, nullptr);
    job_.set_deadline(JobContext::Clock::now() + kPatience);
  }

  std::unique_ptr<Client> ClientWith(const CallSettings& settings) {
    ConnectOptions options;
    options.timeout = kPatience;
    options.token = token_;
    options.settings = settings;
    options.retries = 0;
    auto client = Client::Connect(server_->address(), options);
    EXPECT_TRUE(client.ok()) << client.status();
    return client.ok() ? *std::move(client) : nullptr;
  }

  void Fault(const std::string& text) {
    std::ofstream(faults_ + ".new") << text << " change=" << ++changes_;
    ASSERT_EQ(std::rename((faults_ + ".new").c_str(), faults_.c_str()), 0);
  }

  double Sample(const std::string& name) { return SampleOf(HttpGet(http_, "/metrics"), "voxelpipe_" + name); }
  // Some count a moment after the client has its answer.
  bool Becomes(const std::string& name, const std::function<bool(double)>& holds) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!holds(Sample(name))) {
      if (std::chrono::steady_clock::now() > end) {
        ADD_FAILURE() << name << " is " << Sample(name);
        return false;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }
  bool Becomes(const std::string& name, double value) {
    return Becomes(name, [&](double now) { return now == value; });
  }

  static VoxelizeRequest Small(BackendChoice backend) {
    VoxelizeRequest request = SmallRequest();
    request.backend = backend;
    return request;
  }
  absl::Status Ask(const VoxelizeRequest& request, const CallSettings& settings = {}) {
    return ClientWith(settings)->Voxelize(glb_, MeshFormat::kGlb, request, job_).status();
  }
  absl::Status Ask(const VoxelizeRequest& request, std::chrono::milliseconds deadline) {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + deadline);
    return client_->Voxelize(glb_, MeshFormat::kGlb, request, job).status();
  }
  std::unique_ptr<BackgroundCall> Slow() {
    return std::make_unique<BackgroundCall>(*client_, LargeTrianglesGlb(20000), SlowRequest());
  }
  std::string Upload(const std::vector<uint8_t>& bytes) {
    const auto mesh = client_->UploadMesh(bytes, MeshFormat::kAuto, job_);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.value_or(StoredMesh{}).name;
  }

  const TemporaryDirectory directory_;
  const std::string faults_ = directory_ / "faults";
  const std::string tokens_ = directory_ / "tokens.json";
  const std::vector<uint8_t> glb_ = TorusGlb(8);
  int changes_ = 0;
  JobContext job_;
  std::string http_, token_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(MetricsPathTest, DevicesThatFail) {
  ASSERT_NO_FATAL_FAILURE(Start({"--probe-interval-ms", "20", "--max-probe-interval-ms", "40"}));
  CallSettings may_fall_back;
  may_fall_back.fallback = true;
  const VoxelizeRequest cuda = Small(BackendChoice::kCuda);
  ASSERT_TRUE(Ask(cuda, may_fall_back).ok());
  EXPECT_TRUE(Becomes("device_jobs_total{device=\"cuda:0\"}", 1));
  EXPECT_EQ(Sample("job_fallbacks_total"), 0);
  // The one that finds out runs again elsewhere, the next one goes there at once.
  Fault("kind=lost stage=fine_raster runs=1 probes=1000000");
  ASSERT_TRUE(Ask(cuda, may_fall_back).ok());
  EXPECT_TRUE(Becomes("job_fallbacks_total", 1));
  EXPECT_EQ(Sample("job_retries_total"), 1);
  ASSERT_TRUE(Ask(cuda, may_fall_back).ok());
  EXPECT_TRUE(Becomes("job_fallbacks_total", 2));
  EXPECT_EQ(Sample("job_retries_total"), 1);
  EXPECT_EQ(Sample("device_failures_total{device=\"cuda:0\"}"), 1);
  EXPECT_EQ(Sample("device_quarantines_total{device=\"cuda:0\"}"), 1);
  EXPECT_EQ(Sample("device_serving{device=\"cuda:0\"}"), 0);
  EXPECT_TRUE(Becomes("device_probes_failed_total{device=\"cuda:0\"}", [](double n) { return n > 0; }));
  // One that leaves the device open and fails on the GPU falls back, too; one that names the CPU does not.
  Fault("");
  ASSERT_TRUE(Becomes("device_serving{device=\"cuda:0\"}", 1));
  ASSERT_TRUE(Ask(Small(BackendChoice::kCpu)).ok());
  EXPECT_TRUE(Becomes("device_batches_total{device=\"cpu\"}", 3));
  EXPECT_EQ(Sample("device_jobs_total{device=\"cpu\"}"), 3);
  EXPECT_EQ(Sample("job_fallbacks_total"), 2);
  EXPECT_GT(Sample("device_busy_seconds_total{device=\"cpu\"}"), 0);
}

TEST_F(MetricsPathTest, AQueueThatIsFull) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--backend", "cpu", "--gpus", "none", "--workers", "1", "--threads", "1", "--max-queue", "1"}));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  EXPECT_EQ(Sample("running_jobs"), 1);
  EXPECT_EQ(Sample("device_workers{device=\"cpu\"}"), 1);
  EXPECT_EQ(Sample("device_workers_busy{device=\"cpu\"}"), 1);
  EXPECT_GT(Sample("memory_bytes{budget=\"working\"}"), 0);

  CallSettings patient;
  patient.queue_timeout = std::chrono::milliseconds(50);
  EXPECT_EQ(Ask(SmallRequest(), patient).code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(Sample("queue_timeouts_total"), 1);

  const auto waiting = Slow();
  ASSERT_TRUE(Becomes("queue_jobs{priority=\"normal\"}", 1));
  EXPECT_TRUE(Becomes("queue_bytes", [](double n) { return n > 0; }));
  EXPECT_TRUE(Becomes("queue_predicted_seconds", [](double n) { return n > 0; }));
  EXPECT_EQ(Ask(SmallRequest()).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(Sample("queue_refusals_total{reason=\"jobs\"}"), 1);
  EXPECT_EQ(Sample("jobs_total{code=\"DEADLINE_EXCEEDED\"}"), Sample("queue_timeouts_total"));
}

TEST_F(MetricsPathTest, AQueueThatHoldsTooMuch) {
  for (const auto& [flag, value, reason] :
       {std::tuple{"--max-queue-bytes", "1", "bytes"}, std::tuple{"--max-queue-ms", "1", "time"}}) {
    ASSERT_NO_FATAL_FAILURE(
        Start({"--backend", "cpu", "--gpus", "none", "--workers", "1", "--threads", "1", flag, value}));
    const auto running = Slow();
    ASSERT_TRUE(running->WaitUntilPlanned());
    const auto waiting = Slow();  // the first one may always wait
    ASSERT_TRUE(Becomes("queue_jobs{priority=\"normal\"}", 1));
    EXPECT_EQ(Ask(SmallRequest()).code(), absl::StatusCode::kResourceExhausted);
    EXPECT_EQ(Sample(std::string("queue_refusals_total{reason=\"") + reason + "\"}"), 1);
  }
}

TEST_F(MetricsPathTest, ADeadlineThatCannotBeMet) {
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cpu", "--gpus", "none", "--workers", "1", "--threads", "1"}));
  VoxelizeRequest endless = SlowRequest();
  endless.grid.resolution = 1000;
  endless.targets[0].components = 4;
  EXPECT_FALSE(Ask(endless, std::chrono::milliseconds(200)).ok());
  EXPECT_EQ(Sample("queue_refusals_total{reason=\"deadline\"}"), 1);
}

TEST_F(MetricsPathTest, MeshesAndResultsThatMakeRoom) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--backend", "cpu", "--max-mesh-store-bytes", "100KiB", "--result-cache-bytes", "40000"}));
  const std::string id = Upload(glb_);
  VoxelizeRequest request = SmallRequest();
  for (const double fill : {1, 2, 3, 4, 5, 6, 7, 8, 1}) {  // the last one's result has gone for others
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].blend = Blend::kMax;
    request.targets[0].fill_values = {fill};
    request.fill = Fill::kParity;
    const absl::Status status = client_->VoxelizeStored(id, request, job_).status();
    ASSERT_TRUE(status.ok()) << status;
  }
  EXPECT_EQ(Sample("mesh_store_hits_total"), 9);
  EXPECT_EQ(Sample("mesh_store_meshes"), 1);
  EXPECT_GT(Sample("mesh_store_bytes"), 0);
  EXPECT_EQ(Sample("mesh_store_limit_bytes"), 100 << 10);
  EXPECT_EQ(Sample("result_cache_misses_total"), 9);
  EXPECT_GT(Sample("result_cache_evictions_total"), 0);
  EXPECT_GT(Sample("result_cache_bytes"), 0);
  EXPECT_EQ(Sample("result_cache_limit_bytes"), 40000);
  EXPECT_FALSE(client_->VoxelizeStored("meshes/" + std::string(64, '0'), SmallRequest(), job_).ok());
  EXPECT_EQ(Sample("mesh_store_misses_total"), 1);
  for (int side = 9; side < 30; ++side) Upload(TorusGlb(side));
  EXPECT_GT(Sample("mesh_store_evictions_total"), 0);
}

// The same of many jobs on a stream as of single calls: in messages of their own, and in pieces.
TEST_F(MetricsPathTest, BytesBeforeAndAfterCompression) {
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cpu"}));
  CallSettings compressed;
  compressed.compression = Compression::kZstd;
  double sent = 0, raw = 0;
  for (const int64_t resolution : {32, 96}) {
    VoxelizeRequest request = SmallRequest();
    request.grid.resolution = resolution;
    request.grid.fit = GridFit::kCube;
    request.targets[0].format = VoxelFormat::kU16;
    request.targets[0].blend = Blend::kReplace;
    const double bytes = 2.0 * double(resolution * resolution * resolution);
    ASSERT_TRUE(Ask(request, compressed).ok());
    EXPECT_TRUE(Becomes("result_bytes_total", raw + bytes));
    const double of_single = Sample("sent_bytes_total") - sent;
    EXPECT_GT(of_single, 0);
    EXPECT_LT(of_single, bytes / 4);
    const auto client = ClientWith(compressed);
    const auto stream = client->OpenMany(job_);
    ASSERT_TRUE(stream->Send(1, glb_, MeshFormat::kGlb, request).ok());
    stream->FinishSending();
    const auto answer = stream->Receive();
    ASSERT_TRUE(answer.ok() && answer->result.ok());
    EXPECT_FALSE(stream->Receive().ok());
    EXPECT_TRUE(Becomes("result_bytes_total", raw += 2 * bytes));
    EXPECT_EQ(Sample("sent_bytes_total"), sent += 2 * of_single);
  }
}

TEST_F(MetricsPathTest, QuotasThatAreUsedUp) {
  std::ofstream(tokens_)
      << R"({"clients": [{"name": "farm", "token": "token-of-the-farm", "role": "user", "calls_at_once": 1}]})";
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cpu", "--threads", "1", "--token-file", tokens_}, "token-of-the-farm"));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  EXPECT_EQ(Ask(SmallRequest()).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(Sample("refused_total{reason=\"quota_calls\"}"), 1);
  server_->Signal(SIGHUP);
  EXPECT_TRUE(Becomes("reloads_total", 1));
}

}  // namespace
}  // namespace voxelpipe::testing
