#include "base/machine.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "gtest/gtest.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMiB = 1 << 20;
// The kernel's way to say that version 1 has no bound.
constexpr char kNoBound[] = "9223372036854771712\n";

constexpr char kSecondOnly[] =
    "29 23 0:26 / /sys/fs/cgroup rw,nosuid,nodev,noexec,relatime shared:4 - cgroup2 cgroup2 rw,nsdelegate\n";
constexpr char kFirstOnly[] =
    "31 23 0:28 / /sys/fs/cgroup ro,nosuid - tmpfs tmpfs ro,mode=755\n"
    "33 31 0:30 / /sys/fs/cgroup/cpu,cpuacct rw,relatime shared:9 - cgroup cgroup rw,cpu,cpuacct\n"
    "35 31 0:32 / /sys/fs/cgroup/memory rw,relatime - cgroup cgroup rw,memory\n";

// A directory with "proc" and "sys" of a machine with 16 CPUs and 8 GiB.
class MachineTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Write("proc/self/status",
          "Name:\tvoxelpiped\nCpus_allowed:\tffff\nCpus_allowed_list:\t0-15\nMems_allowed_list:\t0\n");
    Write("proc/meminfo", "MemTotal:        8388608 kB\nMemFree:          123456 kB\n");
  }

  void Write(const std::string& name, std::string_view text) {
    const std::filesystem::path file = root_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  void SecondVersion(std::string_view group) {
    Write("proc/self/mountinfo", kSecondOnly);
    Write("proc/self/cgroup", "0::" + std::string(group) + "\n");
  }
  void FirstVersion(std::string_view group) {
    Write("proc/self/mountinfo", kFirstOnly);
    Write("proc/self/cgroup",
          "9:cpu,cpuacct:" + std::string(group) + "\n4:memory:" + std::string(group) + "\n1:name=systemd:/\n0::/\n");
  }
  MachineLimits Read() const { return ReadMachineLimits(root_); }

  const testing::TemporaryDirectory directory_;
  const std::filesystem::path root_ = directory_.path();
};

TEST_F(MachineTest, TheWholeMachineWhereNoControlGroupBoundsIt) {
  SecondVersion("/user.slice");
  const MachineLimits limits = Read();
  EXPECT_EQ(limits.cpus, 16);
  EXPECT_EQ(limits.affinity_cpus, 16);
  EXPECT_EQ(limits.quota_cpus, 0);
  EXPECT_EQ(limits.physical_bytes, 8192 * kMiB);
  EXPECT_EQ(limits.memory_bytes, 8192 * kMiB / 10 * 9);
  EXPECT_EQ(limits.bound_bytes, 0u);
  EXPECT_EQ(ToString(limits), "16 CPUs (affinity 16), 7372.8 MiB of memory (9/10 of the machine's 8192.0 MiB)");
}

TEST_F(MachineTest, AFractionOfACpuIsRoundedUp) {
  SecondVersion("/a");
  const struct {
    const char* text;
    int cpus;
  } cases[] = {{"150000 100000\n", 2},   {"200000 100000\n", 2},  {"10000 100000\n", 1},
               {"100001 100000\n", 2},   {"100000 100000\n", 1},  {"max 100000\n", 16},
               {"6400000 100000\n", 16}, {"700000 1000000\n", 1}, {"", 16},
               {"garbage 100000\n", 16}, {"100000\n", 16},        {"100000 0\n", 16},
               {"0 100000\n", 16},       {"-1 100000\n", 16},     {"9223372036854775807 1\n", 16}};
  for (const auto& one : cases) {
    Write("sys/fs/cgroup/a/cpu.max", one.text);
    EXPECT_EQ(Read().cpus, one.cpus) << one.text;
  }
}

TEST_F(MachineTest, TheTightestOfAllAncestorsCounts) {
  SecondVersion("/kube/pod/container");
  Write("sys/fs/cgroup/kube/cpu.max", "800000 100000\n");
  Write("sys/fs/cgroup/kube/pod/cpu.max", "250000 100000\n");
  Write("sys/fs/cgroup/kube/pod/container/cpu.max", "max 100000\n");
  Write("sys/fs/cgroup/kube/memory.max", "536870912\n");
  Write("sys/fs/cgroup/kube/pod/memory.max", "max\n");
  Write("sys/fs/cgroup/kube/pod/container/memory.max", "1073741824\n");
  const MachineLimits limits = Read();
  EXPECT_EQ(limits.cpus, 3);
  EXPECT_EQ(limits.quota_cpus, 2.5);
  EXPECT_EQ(limits.quota_group, "/sys/fs/cgroup/kube/pod");
  EXPECT_EQ(limits.bound_bytes, 512 * kMiB);
  EXPECT_EQ(limits.bound_group, "/sys/fs/cgroup/kube");
  EXPECT_EQ(limits.memory_bytes, 512 * kMiB / 10 * 9);
  EXPECT_EQ(ToString(limits),
            "3 CPUs (affinity 16, quota 2.5 by /sys/fs/cgroup/kube/pod), 460.8 MiB of memory (9/10 of 512.0 MiB by "
            "/sys/fs/cgroup/kube)");
}

TEST_F(MachineTest, AffinityBelowTheQuotaCounts) {
  SecondVersion("/a");
  Write("sys/fs/cgroup/a/cpu.max", "800000 100000\n");
  Write("proc/self/status", "Cpus_allowed_list:\t2,4-6,9\n");
  EXPECT_EQ(Read().affinity_cpus, 5);
  EXPECT_EQ(Read().cpus, 5);
  Write("proc/self/status", "Cpus_allowed_list:\t0\n");
  EXPECT_EQ(Read().cpus, 1);
}

TEST_F(MachineTest, MemoryHighCountsAsABound) {
  SecondVersion("/a");
  Write("sys/fs/cgroup/a/memory.max", "1073741824\n");
  Write("sys/fs/cgroup/a/memory.high", "268435456\n");
  EXPECT_EQ(Read().bound_bytes, 256 * kMiB);
}

// In a container with a namespace of its own the group is "/", and what bounds it stands at the mount point.
TEST_F(MachineTest, TheMountPointIsTheContainersOwnGroup) {
  SecondVersion("/");
  Write("sys/fs/cgroup/cpu.max", "150000 100000\n");
  Write("sys/fs/cgroup/memory.max", "536870912\n");
  EXPECT_EQ(Read().cpus, 2);
  EXPECT_EQ(Read().bound_bytes, 512 * kMiB);
  EXPECT_EQ(Read().quota_group, "/sys/fs/cgroup");
}

// /proc/self/cgroup may name the host's path, or one above the namespace, which are not in the container's tree.
TEST_F(MachineTest, APathThatIsNotThereLeavesTheMountPoint) {
  for (const char* group : {"/system.slice/docker-1f.scope", "/../../other", "/a/b (deleted)"}) {
    SecondVersion(group);
    Write("sys/fs/cgroup/cpu.max", "300000 100000\n");
    Write("sys/fs/cgroup/memory.max", "268435456\n");
    EXPECT_EQ(Read().cpus, 3) << group;
    EXPECT_EQ(Read().bound_bytes, 256 * kMiB) << group;
  }
}

TEST_F(MachineTest, FirstVersion) {
  FirstVersion("/docker/1f");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/docker/1f/cpu.cfs_quota_us", "150000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/docker/1f/cpu.cfs_period_us", "100000\n");
  Write("sys/fs/cgroup/memory/memory.limit_in_bytes", kNoBound);
  Write("sys/fs/cgroup/memory/docker/memory.limit_in_bytes", "536870912\n");
  Write("sys/fs/cgroup/memory/docker/1f/memory.limit_in_bytes", kNoBound);
  const MachineLimits limits = Read();
  EXPECT_EQ(limits.cpus, 2);
  EXPECT_EQ(limits.quota_group, "/sys/fs/cgroup/cpu,cpuacct/docker/1f");
  EXPECT_EQ(limits.bound_bytes, 512 * kMiB);
  EXPECT_EQ(limits.bound_group, "/sys/fs/cgroup/memory/docker");
}

TEST_F(MachineTest, FirstVersionWithoutBounds) {
  FirstVersion("/");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  Write("sys/fs/cgroup/memory/memory.limit_in_bytes", kNoBound);
  EXPECT_EQ(Read().cpus, 16);
  EXPECT_EQ(Read().bound_bytes, 0u);
}

// Without a namespace of its own a container is shown its group alone, mounted where the whole tree is elsewhere.
TEST_F(MachineTest, AMountOfTheContainersGroupAlone) {
  FirstVersion("/docker/1f/inner");
  Write("proc/self/mountinfo",
        "33 31 0:30 /docker/1f /sys/fs/cgroup/cpu,cpuacct ro - cgroup cgroup rw,cpu,cpuacct\n"
        "35 31 0:32 /docker/1f /sys/fs/cgroup/memory ro - cgroup cgroup rw,memory\n");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "400000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/inner/cpu.cfs_quota_us", "50000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/inner/cpu.cfs_period_us", "50000\n");
  Write("sys/fs/cgroup/memory/memory.limit_in_bytes", "1073741824\n");
  EXPECT_EQ(Read().cpus, 1);
  EXPECT_EQ(Read().quota_group, "/sys/fs/cgroup/cpu,cpuacct/inner");
  EXPECT_EQ(Read().bound_bytes, 1024 * kMiB);

  // "/docker/1fe" only begins like the group that is mounted.
  FirstVersion("/docker/1fe");
  Write("proc/self/mountinfo", "33 31 0:30 /docker/1f /sys/fs/cgroup/cpu,cpuacct ro - cgroup cgroup rw,cpu,cpuacct\n");
  Write("sys/fs/cgroup/cpu,cpuacct/e/cpu.cfs_quota_us", "100\n");
  Write("sys/fs/cgroup/cpu,cpuacct/e/cpu.cfs_period_us", "100\n");
  EXPECT_EQ(Read().cpus, 4);
}

TEST_F(MachineTest, FirstVersionKnowsOfAncestorsThatCannotBeSeen) {
  FirstVersion("/");
  Write("sys/fs/cgroup/memory/memory.limit_in_bytes", kNoBound);
  Write("sys/fs/cgroup/memory/memory.stat", "cache 1\nhierarchical_memory_limit 268435456\ntotal_cache 1\n");
  EXPECT_EQ(Read().bound_bytes, 256 * kMiB);
}

// Some controllers of version 1, and the tree of version 2 beside them.
TEST_F(MachineTest, BothVersionsAtOnce) {
  Write("proc/self/mountinfo",
        "33 31 0:30 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n"
        "41 31 0:38 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n");
  Write("proc/self/cgroup", "1:cpu:/a\n0::/b\n");
  Write("sys/fs/cgroup/cpu/a/cpu.cfs_quota_us", "350000\n");
  Write("sys/fs/cgroup/cpu/a/cpu.cfs_period_us", "100000\n");
  Write("sys/fs/cgroup/unified/b/memory.max", "134217728\n");
  EXPECT_EQ(Read().cpus, 4);
  EXPECT_EQ(Read().bound_bytes, 128 * kMiB);
  EXPECT_EQ(Read().bound_group, "/sys/fs/cgroup/unified/b");
}

TEST_F(MachineTest, BlanksInAMountPoint) {
  Write("proc/self/mountinfo", "29 23 0:26 / /mnt/control\\040groups rw - cgroup2 cgroup2 rw\n");
  Write("proc/self/cgroup", "0::/a:b\n");
  Write("mnt/control groups/a:b/cpu.max", "100000 100000\n");
  EXPECT_EQ(Read().cpus, 1);
}

TEST_F(MachineTest, BrokenFilesBoundNothing) {
  Write("proc/self/mountinfo", "nonsense\n29 23 0:26\n29 23 0:26 / /sys/fs/cgroup rw - cgroup2\n\n");
  Write("proc/self/cgroup", "0\n::\n0:/\n");
  EXPECT_EQ(Read().cpus, 16);
  EXPECT_EQ(Read().memory_bytes, 8192 * kMiB / 10 * 9);
}

// Where /proc is not mounted, the system is asked directly.
TEST_F(MachineTest, NoFilesAtAll) {
  std::filesystem::remove_all(root_);
  const MachineLimits limits = Read();
  EXPECT_GE(limits.cpus, 1);
  EXPECT_GE(limits.memory_bytes, 64 * kMiB);
  EXPECT_LE(limits.memory_bytes, limits.physical_bytes);
}

TEST_F(MachineTest, TheProcessHasWhatWasReadLast) {
  const MachineLimits limits = RefreshMachine();
  EXPECT_EQ(CpuCount(), limits.cpus);
  EXPECT_EQ(MemoryBytes(), limits.memory_bytes);
  EXPECT_EQ(ReadMachineLimits().cpus, limits.cpus);
}

}  // namespace
}  // namespace voxelpipe
