#include "observe/idle_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "grid/idle_pages.h"

namespace voxelpipe {
namespace {

uint64_t ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  uint64_t size = 0, resident = 0;
  if (!(file >> size >> resident)) return 0;
  return resident * uint64_t(sysconf(_SC_PAGESIZE));
}

}  // namespace

HeldMemory MemoryOfThisProcess() {
  return {&ResidentBytes, [] { return uint64_t(mallinfo2().fordblks); }, [] { malloc_trim(0); },
          &ReleasePagesIdleSince};
}

void IdleMemory::Look(std::chrono::milliseconds unused_for, Clock::time_point now) {
  memory_.release_blocks(now - unused_for);
  const uint64_t resident = memory_.resident_bytes(), free = memory_.free_bytes();
  resident_ = std::min(resident_, resident);
  free_ = std::min(free_, free);
  if (resident < resident_ + kWorthwhileBytes && free < free_ + kWorthwhileBytes) return;
  memory_.trim();
  resident_ = memory_.resident_bytes();
  free_ = memory_.free_bytes();
}

}  // namespace voxelpipe
