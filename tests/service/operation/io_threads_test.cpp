// gRPC's threads, and those of them that serve.
#include <signal.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

// Of each thread that gRPC polls with: how often it waited.
std::map<std::string, uint64_t> Waits(pid_t pid) {
  std::map<std::string, uint64_t> waits;
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    std::string name, line;
    std::getline(std::ifstream(task.path() / "comm"), name);
    if (name != "nexting_thread") continue;
    std::ifstream status(task.path() / "status");
    while (std::getline(status, line)) {
      constexpr std::string_view kKey = "voluntary_ctxt_switches:";
      if (line.starts_with(kKey)) waits[task.path().filename()] = std::stoull(line.substr(kKey.size()));
    }
  }
  return waits;
}

// How many of them served while calls of every kind came from several clients.
size_t ServingThreads(const std::vector<std::string>& arguments) {
  const auto server = StartServer(arguments);
  if (server == nullptr) return 0;
  const std::map<std::string, uint64_t> before = Waits(server->pid());
  const std::vector<uint8_t> glb = TorusGlb(8);
  VoxelizeRequest large = SmallRequest();
  large.grid.resolution = 200;
  std::vector<std::thread> clients;
  for (int i = 0; i < 4; ++i) {
    clients.emplace_back([&] {
      const auto client = ConnectTo(*server);
      ASSERT_NE(client, nullptr);
      JobContext job;
      job.set_deadline(JobContext::Clock::now() + kPatience);
      const auto mesh = client->UploadMesh(glb, MeshFormat::kGlb, job);
      ASSERT_TRUE(mesh.ok()) << mesh.status();
      for (int call = 0; call < 50; ++call) {
        ASSERT_TRUE(client->Voxelize(glb, MeshFormat::kGlb, call % 10 == 0 ? large : SmallRequest(), job).ok());
        ASSERT_TRUE(client->ServerInfo().ok());
      }
    });
  }
  for (std::thread& client : clients) client.join();
  size_t serving = 0;
  for (const auto& [thread, waits] : Waits(server->pid())) {
    // One that was still starting, or that ends, waits a few times; one that serves waits for every call.
    constexpr uint64_t kMaxOthers = 8;
    const auto known = before.find(thread);
    if (waits > (known == before.end() ? 0 : known->second) + kMaxOthers) ++serving;
  }
  server->Signal(SIGTERM);
  const auto ended = server->Wait();
  EXPECT_TRUE(ended.ok() && ended->exit_code == 0) << "those that were held must not hold up the end";
  return serving;
}

TEST(IoThreadsTest, AsManyServeAsTheOperatorWants) {
  const std::vector<std::string> quick = {"--log-level", "warn", "--lame-duck-ms", "0"};
  const auto with = [&](const char* threads) {
    std::vector<std::string> all = quick;
    all.insert(all.end(), {"--io-threads", threads});
    return ServingThreads(all);
  };
  EXPECT_EQ(with("1"), 1u);
  EXPECT_EQ(with("2"), 2u);
}

}  // namespace
}  // namespace voxelpipe::testing
