#include "base/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

namespace voxelpipe {

uint64_t MemoryBytes() {
  uint64_t bytes = uint64_t(sysconf(_SC_PHYS_PAGES)) * uint64_t(sysconf(_SC_PAGE_SIZE));
  // Version 2 and version 1 of control groups; "max" or no file: no bound.
  for (const char* path : {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::ifstream file(path);
    uint64_t bound = 0;
    if (file >> bound && bound > 0) bytes = std::min(bytes, bound);
  }
  return bytes;
}

}  // namespace voxelpipe
