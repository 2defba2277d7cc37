// The resources of a process, from the kernel.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace voxelpipe::testing {

struct ProcessFacts {
  int descriptors = 0;
  int threads = 0;
  uint64_t resident_bytes = 0;  // current resident memory
  uint64_t peak_bytes = 0;      // its maximum so far

  std::string ToString() const;
};

// Of a process of this user; zeros if there is none.
ProcessFacts ReadProcessFacts(pid_t pid);

// Its running child processes.
std::vector<pid_t> ChildrenOf(pid_t pid);

// Polls until descriptors, threads and memory (within a MiB) have not changed for half a second, at most for kPatience:
// resources of a peer are freed a little after its end.
ProcessFacts SettledProcessFacts(pid_t pid);

// True if a process has a sanitizer, whose shadow and quarantine grow the resident memory. It need not be of this
// build.
bool IsSanitized(pid_t pid);

}  // namespace voxelpipe::testing
