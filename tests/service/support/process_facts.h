// What the kernel says that a process holds.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace voxelpipe::testing {

struct ProcessFacts {
  int descriptors = 0;
  int threads = 0;
  uint64_t resident_bytes = 0;  // what stands in memory now
  uint64_t peak_bytes = 0;      // the most that ever did

  std::string ToString() const;
};

// Of a process of this user; zeros where there is none.
ProcessFacts ReadProcessFacts(pid_t pid);

// The processes that it has started and that have not ended.
std::vector<pid_t> ChildrenOf(pid_t pid);

// Asks again until descriptors, threads and memory (but for a MiB) have not changed for half a second, or for
// kPatience: what a peer left behind goes a little after it.
ProcessFacts SettledProcessFacts(pid_t pid);

// Whether a process carries a sanitizer, whose shadow and quarantine grow the resident memory. It need not be of this
// build.
bool IsSanitized(pid_t pid);

}  // namespace voxelpipe::testing
