// What a server makes of the CPUs that it may run on.
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "base/machine.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

cpu_set_t AffinityOf(pid_t pid) {
  cpu_set_t mask;
  CPU_ZERO(&mask);
  EXPECT_EQ(sched_getaffinity(pid, sizeof mask, &mask), 0);
  return mask;
}

cpu_set_t OneOf(const cpu_set_t& mask) {
  cpu_set_t one;
  CPU_ZERO(&one);
  for (int cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu) {
    if (CPU_ISSET(cpu, &mask)) CPU_SET(cpu, &one);
  }
  return one;
}

// What starts meanwhile may run on one CPU only, as by taskset -c.
class OnOneCpu {
 public:
  OnOneCpu() : before_(AffinityOf(0)) {
    const cpu_set_t one = OneOf(before_);
    EXPECT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
  }
  ~OnOneCpu() { EXPECT_EQ(sched_setaffinity(0, sizeof before_, &before_), 0); }

 private:
  const cpu_set_t before_;
};

uint32_t CpuWorkersOf(const ServerDescription& server) {
  const auto cpu = std::find_if(server.devices.begin(), server.devices.end(),
                                [](const auto& device) { return device.name == "cpu"; });
  return cpu == server.devices.end() ? 0 : cpu->workers;
}

TEST(MachineTest, AServerOnOneCpu) {
  std::unique_ptr<ServerProcess> server;
  {
    const OnOneCpu on_one;
    server = StartServer({"--log-level", "warn"});
  }
  ASSERT_TRUE(server);
  const auto info = ConnectTo(*server)->ServerInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->threads, 1u);
  EXPECT_EQ(info->workers, 1u) << "loaders";
  EXPECT_EQ(CpuWorkersOf(*info), 1u);
}

TEST(MachineTest, AServerOnTheWholeMachine) {
  const auto server = StartServer({"--log-level", "warn"});
  ASSERT_TRUE(server);
  const auto info = ConnectTo(*server)->ServerInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->threads, uint32_t(CpuCount()));
  EXPECT_EQ(CpuWorkersOf(*info), uint32_t(std::min(4, CpuCount())));
}

// A control group of the kernel with half a CPU and 512 MiB, in the version that this machine has; removed with the
// object.
class ControlGroup {
 public:
  // Empty: none can be made here.
  ControlGroup() {
    const std::filesystem::path root = "/sys/fs/cgroup";
    if (std::filesystem::exists(root / "cgroup.controllers")) {
      Make(root, {{"cpu.max", "50000 100000"}, {"memory.max", "536870912"}});
    } else if (Make(root / "cpu", {{"cpu.cfs_quota_us", "50000"}})) {
      Make(root / "memory", {{"memory.limit_in_bytes", "536870912"}});
    }
  }
  ~ControlGroup() {
    for (const auto& folder : folders_) std::filesystem::remove(folder, ignored_);
  }
  bool whole() const { return whole_; }
  bool Take(pid_t pid) const {
    return std::all_of(folders_.begin(), folders_.end(),
                       [&](const auto& folder) { return Write(folder / "cgroup.procs", std::to_string(pid)); });
  }

 private:
  static bool Write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream out(file);
    out << text << std::flush;
    return out.good();
  }
  // A group of its own below `parent`.
  bool Make(const std::filesystem::path& parent, const std::map<std::string, std::string>& files) {
    std::string pattern = (parent / "voxelpipe_test_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) return whole_ = false;
    const std::filesystem::path& folder = folders_.emplace_back(pattern);
    whole_ = std::all_of(files.begin(), files.end(), [&](const auto& file) {
      return std::filesystem::exists(folder / file.first) && Write(folder / file.first, file.second);
    });
    return whole_;
  }

  std::vector<std::filesystem::path> folders_;
  bool whole_ = false;
  std::error_code ignored_;
};

TEST(MachineTest, AServerInAControlGroup) {
  const ControlGroup group;
  if (!group.whole()) GTEST_SKIP() << "control groups with CPUs and memory cannot be made here";
  const auto server = StartServer({"--log-level", "warn"});
  ASSERT_TRUE(server);
  ASSERT_TRUE(group.Take(server->pid()));
  server->Signal(SIGHUP);
  const auto client = ConnectTo(*server);
  const auto end = std::chrono::steady_clock::now() + kPatience;
  absl::StatusOr<ServerDescription> info = client->ServerInfo();
  while (info.ok() && info->threads != 1 && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    info = client->ServerInfo();
  }
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->threads, 1u);
  EXPECT_EQ(info->max_mesh_store_bytes, (uint64_t{512} << 20) / 10 * 9 / 16);
  server->Signal(SIGTERM);
  EXPECT_TRUE(server->Wait().ok());
}

// It reads its limits again every 30 seconds, and at once on SIGHUP.
TEST(MachineTest, AServerFollowsWhenItsCpusChange) {
  const auto server = StartServer({"--log-level", "warn"});
  ASSERT_TRUE(server);
  const auto client = ConnectTo(*server);
  const cpu_set_t all = AffinityOf(server->pid()), one = OneOf(all);
  const auto becomes = [&](const cpu_set_t& mask) {
    EXPECT_EQ(sched_setaffinity(server->pid(), sizeof mask, &mask), 0);
    server->Signal(SIGHUP);
    const uint32_t cpus = uint32_t(std::min(CPU_COUNT(&mask), CpuCount()));
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < end) {
      const auto info = client->ServerInfo();
      if (!info.ok()) return ::testing::AssertionFailure() << info.status();
      if (info->threads == cpus && CpuWorkersOf(*info) == std::min(4u, cpus)) return ::testing::AssertionSuccess();
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return ::testing::AssertionFailure() << "it does not have " << cpus << " CPUs";
  };
  EXPECT_TRUE(becomes(one));
  EXPECT_TRUE(becomes(all));
}

}  // namespace
}  // namespace voxelpipe::testing
