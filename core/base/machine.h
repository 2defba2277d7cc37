// The number of CPUs and the memory that this process may use: those of the machine, or of its container.
//
// Every count of CPUs and every default that follows memory comes from here alone: in a container with a small share of
// the machine, the standard library, sysconf and oneTBB all report the whole machine.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace voxelpipe {

struct MachineLimits {
  int cpus = 1;  // the CPUs that the process may run on, or its quota rounded up, whichever is less; at least 1
  uint64_t memory_bytes =
      0;  // nine tenths of the smallest of the machine's memory and the bounds of all control groups

  int affinity_cpus = 1;        // CPUs that the process may run on
  double quota_cpus = 0;        // the smallest quota of the control groups, in CPUs; 0: none
  std::string quota_group;      // directory of the group that has it
  uint64_t physical_bytes = 0;  // of the machine
  uint64_t bound_bytes = 0;  // the smallest bound of the control groups; 0: none that is less than the machine's memory
  std::string bound_group;   // directory of the group that has it

  friend bool operator==(const MachineLimits&, const MachineLimits&) = default;
};

// Reads them: /proc/self/status (affinity), /proc/meminfo, and of /proc/self/cgroup and /proc/self/mountinfo the
// control groups of this process, versions 1 and 2 or both, with all visible ancestors. Files that are missing or
// cannot be read set no bound. `root`: the directory that holds "proc" and "sys"; for tests.
MachineLimits ReadMachineLimits(const std::filesystem::path& root = "/");

// "2 CPUs (affinity 16, quota 1.5 by /sys/fs/cgroup/a), 460.8 MiB of memory (9/10 of 512.0 MiB by /sys/fs/cgroup/a)".
std::string ToString(const MachineLimits& limits);

// The limits of the last read; the first call reads them. Thread-safe and cheap.
int CpuCount();
uint64_t MemoryBytes();

// Reads the limits again, for CpuCount and MemoryBytes too. Thread-safe.
MachineLimits RefreshMachine();

}  // namespace voxelpipe
