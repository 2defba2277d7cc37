// With the processes of the server's own program.
#include "isolate/load_workers.h"

#include <signal.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "isolate/sandbox.h"
#include "mesh/mesh_bytes.h"
#include "support/meshes/compressed_meshes.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;

std::unique_ptr<LoadWorkers> StartWorkers(int workers, uint64_t kept_bytes) {
  LoadWorkersOptions options;
  options.workers = workers;
  options.unused = std::chrono::milliseconds(0);
  options.kept_bytes = kept_bytes;
  options.process.program = VOXELPIPED_PATH;
  absl::StatusOr<std::unique_ptr<LoadWorkers>> started = LoadWorkers::Start(options);
  EXPECT_TRUE(started.ok()) << started.status();
  return started.ok() ? *std::move(started) : nullptr;
}

// A triangle and a vertex of no triangle, on so many nodes.
std::vector<uint8_t> ManyParts(int nodes) {
  testing::GlbBuilder glb;
  const int mesh = glb.Mesh(glb.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {0, 1, 2}));
  std::vector<int> roots;
  for (int i = 0; i < nodes; ++i) roots.push_back(glb.Node({{"mesh", mesh}}));
  glb.Scene(roots);
  return glb.Glb();
}

TEST(LoadWorkersTest, AllThatALoadedMeshHoldsStaysCharged) {
  const auto workers = StartWorkers(1, 64 * kMiB);
  ASSERT_NE(workers, nullptr);
  MemoryBudget memory(1024 * kMiB);
  JobContext job;
  job.set_memory(&memory);
  {
    const auto loaded = workers->Load(ManyParts(2000), {}, job);
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    const TriangleMesh& mesh = loaded->mesh;
    ASSERT_EQ(mesh.parts.size(), 2000u);
    ASSERT_TRUE(mesh.unused_vertices.has_value());
    EXPECT_GE(memory.used_bytes(),
              MeshBytes(mesh) + mesh.parts.size() * sizeof(MeshPart) + mesh.unused_vertices->size() * sizeof(uint32_t));
  }
  EXPECT_EQ(memory.used_bytes(), 0u);
}

// What a process took for a large answer must not pass for what it takes anyway.
TEST(LoadWorkersTest, ALoadAfterALargeOneIsChargedAsTheFirstOne) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "allocators of sanitizers keep what is freed";
  const auto workers = StartWorkers(1, 2 * kMiB);
  ASSERT_NE(workers, nullptr);
  const std::vector<uint8_t> file = testing::DracoFile(testing::TorusShape(700, 700));
  uint64_t first = 0;
  for (int i = 0; i < 3; ++i) {
    MemoryBudget memory(2048 * kMiB);
    JobContext job;
    job.set_memory(&memory);
    const auto loaded = workers->Load(file, {}, job);
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    if (i == 0) first = memory.peak_bytes();
    EXPECT_GE(memory.peak_bytes(), first - first / 5) << "load " << i << " after " << first;
  }
}

// A share is that of the processes that there may be now.
TEST(LoadWorkersTest, ProcessesThatKeepMoreThanTheirShareEndWhenThereMayBeMore) {
  const auto workers = StartWorkers(1, 16 * kMiB);
  ASSERT_NE(workers, nullptr);
  const JobContext job;
  ASSERT_TRUE(workers->Load(ManyParts(1), {}, job).ok());
  EXPECT_EQ(workers->stats().kept_bytes, 16 * kMiB);
  workers->SetWorkers(8, 32 * kMiB);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (workers->stats().kept_bytes != 4 * kMiB && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_EQ(workers->stats().kept_bytes, 4 * kMiB) << "of one that is not busy";
  EXPECT_TRUE(workers->Load(ManyParts(1), {}, job).ok());
  EXPECT_TRUE(workers->stats().ended.empty()) << "none failed";
}

// The processes that load meshes, which are this one's only children.
std::vector<pid_t> Processes() {
  std::vector<pid_t> children;
  for (const auto& thread : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream file(thread.path() / "children");
    for (pid_t child = 0; file >> child;) children.push_back(child);
  }
  return children;
}

// As the kernel does where memory is short. They were idle: no file is the reason.
TEST(LoadWorkersTest, ProcessesThatDieWhileTheyAreIdleCostNoFileAnError) {
  const auto workers = StartWorkers(3, 64 * kMiB);
  ASSERT_NE(workers, nullptr);
  const JobContext job;
  for (int round = 0; round < 20; ++round) {
    for (const pid_t process : Processes()) kill(process, SIGKILL);
    // In some rounds they have ended by now, in others they are about to.
    if (round % 2 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const auto loaded = workers->Load(ManyParts(1), {}, job);
    ASSERT_TRUE(loaded.ok()) << round << ": " << loaded.status();
  }
  const std::map<std::string, uint64_t> ended = workers->stats().ended;
  EXPECT_GE(ended.count("died") + ended.count("start"), 1u);
}

TEST(LoadWorkersTest, AProcessThatDiesWhileItIsIdleIsReplacedBeforeAFileComes) {
  const auto workers = StartWorkers(1, 64 * kMiB);
  ASSERT_NE(workers, nullptr);
  const JobContext job;
  ASSERT_TRUE(workers->Load(ManyParts(1), {}, job).ok());
  const std::vector<pid_t> before = Processes();
  ASSERT_EQ(before.size(), 1u);
  kill(before[0], SIGKILL);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  const auto replaced = [&] {
    const std::vector<pid_t> now = Processes();
    return now.size() == 1 && now[0] != before[0];
  };
  while (!replaced() && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_TRUE(replaced());
  EXPECT_EQ(workers->stats().ended.at("died"), 1u);
  EXPECT_EQ(workers->stats().questions, 1u);
}

// The file that a process died of is not tried again: it would end the next one.
TEST(LoadWorkersTest, AProcessThatDiesOfItsFileFailsItAtOnce) {
  const auto workers = StartWorkers(1, 64 * kMiB);
  ASSERT_NE(workers, nullptr);
  const JobContext job;
  const std::vector<uint8_t> heavy = testing::DracoFile(testing::TorusShape(1000, 1000));
  ASSERT_TRUE(workers->Load(ManyParts(1), {}, job).ok());
  const std::vector<pid_t> before = Processes();
  ASSERT_EQ(before.size(), 1u);
  const auto cpu_ticks = [&] {
    std::ifstream file("/proc/" + std::to_string(before[0]) + "/stat");
    std::string field;
    for (int i = 0; i < 13; ++i) file >> field;  // no space is in the name of the program
    uint64_t user = 0;
    file >> user;
    return user;
  };
  const uint64_t idle = cpu_ticks();
  std::atomic<bool> ended = false;
  std::thread killer([&] {
    while (cpu_ticks() < idle + 2 && !ended) std::this_thread::sleep_for(std::chrono::milliseconds(1));  // of the file
    kill(before[0], SIGKILL);
  });
  const absl::Status status = workers->Load(heavy, {}, job).status();
  ended = true;
  killer.join();
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal) << status;
  EXPECT_NE(status.message().find("signal 9"), absl::string_view::npos) << status;
  EXPECT_EQ(workers->stats().questions, 2u);
}

}  // namespace
}  // namespace voxelpipe
