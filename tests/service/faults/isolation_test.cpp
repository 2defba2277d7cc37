// Decoders that others wrote run in processes of their own: what becomes of those stays there.
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "job/result.h"
#include "service/support/http_get.h"
#include "service/support/process_facts.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/meshes/compressed_meshes.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

std::vector<std::vector<uint8_t>> BytesOf(const VoxelizeResult& result) {
  std::vector<std::vector<uint8_t>> arrays;
  for (const std::span<const uint8_t> bytes : ArraysOf(result)) arrays.emplace_back(bytes.begin(), bytes.end());
  return arrays;
}

VoxelizeRequest BaseColorRequest() {
  VoxelizeRequest request = SmallRequest();
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].components = 4;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"base_color", {}};
  return request;
}

class IsolationTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--isolate-loading", "on", "--loaders", "2", "--log-level", "off"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
  }
  absl::StatusOr<RemoteResult> Ask(std::span<const uint8_t> file, const JobContext& job,
                                   const VoxelizeRequest& request = SmallRequest()) {
    return client_->Voxelize(file, MeshFormat::kAuto, request, job);
  }
  absl::StatusOr<RemoteResult> Ask(std::span<const uint8_t> file) {
    const JobContext job;
    return Ask(file, job);
  }
  template <typename Condition>
  static bool WaitUntil(Condition condition) {
    const auto end = Clock::now() + kPatience;
    while (!condition()) {
      if (Clock::now() > end) return false;
      std::this_thread::sleep_for(milliseconds(5));
    }
    return true;
  }
  // Stops all processes that load meshes, as soon as there are so many and all of them are ready.
  std::vector<pid_t> StopAll(size_t count) {
    std::vector<pid_t> workers;
    EXPECT_TRUE(WaitUntil([&] {
      workers = ChildrenOf(server_->pid());
      // A call starts another process, unless it ends sooner than that begins.
      if (workers.size() < count) {
        EXPECT_TRUE(Ask(DracoFile(TorusShape(100, 100))).ok());
      }
      return workers.size() == count && std::all_of(workers.begin(), workers.end(), IsSandboxed);
    }));
    std::this_thread::sleep_for(milliseconds(50));  // until they have said so
    for (const pid_t worker : workers) kill(worker, SIGSTOP);
    return workers;
  }
  static bool IsSandboxed(pid_t pid) {
    std::ifstream file("/proc/" + std::to_string(pid) + "/status");
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with("Seccomp:")) return line.find('2') != std::string::npos;
    }
    return false;
  }
  // From --http-listen: true if this many processes are busy.
  bool WaitUntilBusy(int count) {
    const auto http = server_->http_address();
    const std::string line = "voxelpipe_load_workers_busy " + std::to_string(count) + "\n";
    return http.ok() && WaitUntil([&] { return HttpGet(*http, "/metrics").find(line) != std::string::npos; });
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(IsolationTest, TheSameBytesWithAndWithout) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto plain = StartServer({"--isolate-loading", "off", "--log-level", "off"});
  ASSERT_NE(plain, nullptr);
  const auto plain_client = ConnectTo(*plain);
  ASSERT_NE(plain_client, nullptr);
  EXPECT_TRUE(ChildrenOf(plain->pid()).empty());
  const Shape shape = TorusShape(40, 20), large = TorusShape(200, 200);
  const std::vector<std::pair<std::string, std::vector<uint8_t>>> files = {
      {"plain GLB", TorusGlb(8)},        {"Draco", DracoFile(shape, true)}, {"GLB with Draco", DracoGlb(shape)},
      {"large Draco", DracoFile(large)}, {"meshopt", MeshoptGlb(shape)},    {"large meshopt", MeshoptGlb(large)},
      {"PNG", TexturedQuadGlb()},        {"JPEG", JpegQuadGlb(64, 48)}};
  for (const auto& [name, file] : files) {
    for (const VoxelizeRequest& request : {SmallRequest(), BaseColorRequest()}) {
      const JobContext job;
      const auto here = Ask(file, job, request);
      const auto there = plain_client->Voxelize(file, MeshFormat::kAuto, request, job);
      ASSERT_TRUE(here.ok()) << name << ": " << here.status();
      ASSERT_TRUE(there.ok()) << name << ": " << there.status();
      EXPECT_EQ(BytesOf(here->result), BytesOf(there->result)) << name;
      EXPECT_EQ(here->report.triangles, there->report.triangles) << name;
    }
  }
}

TEST_F(IsolationTest, TexturesOfKeptMeshesAreDecodedThereToo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--http-listen", "127.0.0.1:0"}));
  const auto http = server_->http_address();
  ASSERT_TRUE(http.ok());
  const std::vector<uint8_t> file = JpegQuadGlb(64, 48);
  const JobContext job;
  const auto kept = client_->UploadMesh(file, MeshFormat::kGlb, job);
  ASSERT_TRUE(kept.ok()) << kept.status();
  EXPECT_THAT(HttpGet(*http, "/metrics"), HasSubstr("voxelpipe_isolated_loads_total 0\n"));
  const auto stored = client_->VoxelizeStored(kept->name, BaseColorRequest(), job);
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_THAT(HttpGet(*http, "/metrics"), HasSubstr("voxelpipe_isolated_loads_total 1\n"));
  const auto sent = Ask(file, job, BaseColorRequest());
  ASSERT_TRUE(sent.ok()) << sent.status();
  EXPECT_EQ(BytesOf(stored->result), BytesOf(sent->result));
  EXPECT_THAT(HttpGet(*http, "/metrics"), HasSubstr("voxelpipe_isolated_loads_total 2\n"));
}

TEST_F(IsolationTest, ErrorsOfTheLoaderAreTheSame) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<uint8_t> broken = DracoFile(CubeShape());
  broken.resize(broken.size() / 2);
  const absl::Status status = Ask(broken).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("draco"));
  EXPECT_TRUE(Ask(DracoFile(CubeShape())).ok());
}

// Which of two stopped processes gets which call is not told: one is killed, the other goes on.
TEST_F(IsolationTest, AProcessThatIsKilledFailsItsCallAndNoOther) {
  ASSERT_NO_FATAL_FAILURE(Start({"--http-listen", "127.0.0.1:0"}));
  const std::vector<pid_t> workers = StopAll(2);
  ASSERT_EQ(workers.size(), 2u);
  absl::Status first, second;
  std::thread one([&] { first = Ask(DracoFile(TorusShape(100, 100))).status(); });
  std::thread two([&] { second = Ask(DracoFile(TorusShape(100, 100))).status(); });
  EXPECT_TRUE(WaitUntilBusy(2));
  kill(workers[0], SIGKILL);
  kill(workers[1], SIGCONT);
  one.join();
  two.join();
  const absl::Status& failed = first.ok() ? second : first;
  EXPECT_TRUE(first.ok() != second.ok()) << first << "; " << second;
  EXPECT_EQ(failed.code(), absl::StatusCode::kInternal) << failed;
  EXPECT_THAT(std::string(failed.message()), HasSubstr("signal 9 (SIGKILL)"));
  EXPECT_TRUE(server_->IsRunning());
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(Ask(DracoFile(CubeShape())).ok());
}

// A process that is stopped is like a decoder that does not end.
TEST_F(IsolationTest, ADecoderThatDoesNotEndIsEndedAtTheDeadline) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (int i = 0; i < 2; ++i) {
    const std::vector<pid_t> workers = StopAll(2);
    ASSERT_EQ(workers.size(), 2u);
    JobContext job;
    const auto deadline = Clock::now() + milliseconds(300);
    job.set_deadline(deadline);
    const absl::Status status = Ask(DracoFile(CubeShape()), job).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded) << status;
    // Still stopped: one that goes on within its grace answers, and lives on.
    EXPECT_TRUE(WaitUntil([&] {
      const std::vector<pid_t> left = ChildrenOf(server_->pid());
      return std::any_of(workers.begin(), workers.end(),
                         [&](pid_t p) { return std::find(left.begin(), left.end(), p) == left.end(); });
    })) << "the one that did not answer lives on";
    for (const pid_t worker : workers) kill(worker, SIGCONT);
  }
  EXPECT_TRUE(Ask(DracoFile(CubeShape())).ok());
}

TEST_F(IsolationTest, ACancelledCallFreesItsProcess) {
  ASSERT_NO_FATAL_FAILURE(Start({"--http-listen", "127.0.0.1:0"}));
  const std::vector<pid_t> workers = StopAll(2);
  ASSERT_EQ(workers.size(), 2u);
  JobContext job;
  absl::Status status;
  std::thread call([&] { status = Ask(DracoFile(CubeShape()), job).status(); });
  EXPECT_TRUE(WaitUntilBusy(1));
  const auto begin = Clock::now();
  job.Cancel();
  call.join();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled) << status;
  EXPECT_TRUE(WaitUntil([&] {
    return HttpGet(*server_->http_address(), "/metrics")
               .find("voxelpipe_load_workers_ended_total{reason=\"cancelled\"} 1") != std::string::npos;
  }));
  EXPECT_LT(Clock::now() - begin, milliseconds(1000) * kSlowdown);
  for (const pid_t worker : workers) kill(worker, SIGCONT);
}

TEST_F(IsolationTest, MoreMemoryThanThereIsIsResourceExhausted) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-working-bytes", "8MiB"}));
  const absl::Status status = Ask(DracoFile(TorusShape(700, 700))).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_TRUE(Ask(DracoFile(CubeShape())).ok());
}

TEST_F(IsolationTest, NothingIsLeftWhenTheServerIsKilled) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_TRUE(Ask(DracoFile(CubeShape())).ok());
  const std::vector<pid_t> workers = ChildrenOf(server_->pid());
  ASSERT_FALSE(workers.empty());
  server_->Signal(SIGKILL);
  ASSERT_TRUE(server_->Wait().ok());
  const auto alive = [&] {
    return std::any_of(workers.begin(), workers.end(), [](pid_t p) { return kill(p, 0) == 0; });
  };
  const auto end = Clock::now() + kPatience;
  while (alive() && Clock::now() < end) std::this_thread::sleep_for(milliseconds(10));
  EXPECT_FALSE(alive());
}

// A terminal's Ctrl-C and a service manager's stop go to all processes of the group.
TEST_F(IsolationTest, SignalsOfTheWholeGroupLeaveTheEndToTheServer) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0"}));
  ASSERT_TRUE(Ask(DracoFile(CubeShape())).ok());
  for (const pid_t worker : ChildrenOf(server_->pid())) {
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) kill(worker, signal);
  }
  EXPECT_TRUE(Ask(DracoFile(CubeShape())).ok());
  client_.reset();
  server_->Signal(SIGTERM);
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(IsolationTest, IdleProcessesEndAndTheLastOneIsSmall) {
  ASSERT_NO_FATAL_FAILURE(Start({"--idle-memory-ms", "300"}));
  const std::vector<uint8_t> file = DracoFile(TorusShape(400, 400));
  std::vector<std::thread> calls;
  for (int i = 0; i < 4; ++i) calls.emplace_back([&] { EXPECT_TRUE(Ask(file).ok()); });
  for (std::thread& call : calls) call.join();
  const auto end = Clock::now() + kPatience;
  while (ChildrenOf(server_->pid()).size() > 1 && Clock::now() < end) std::this_thread::sleep_for(milliseconds(50));
  const std::vector<pid_t> left = ChildrenOf(server_->pid());
  ASSERT_EQ(left.size(), 1u);
  const ProcessFacts facts = SettledProcessFacts(left[0]);
  if (!IsSanitized(left[0])) {
    EXPECT_LT(facts.resident_bytes, uint64_t{64} << 20) << facts.ToString();
  }
}

}  // namespace
}  // namespace voxelpipe::testing
