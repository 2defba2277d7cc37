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

uint64_t KeptBytesOfThread(uint64_t memory_bytes, int threads) {
  constexpr uint64_t kMin = 1 << 20, kMax = 64 << 20, kShare = 16;
  return std::clamp(memory_bytes / kShare / uint64_t(std::max(1, threads)), kMin, kMax);
}

void KeepFreedMemory(uint64_t bytes_of_thread) {
  // The allocator's own default proportion: arrays above the first are mapped, and unmapped when freed.
  mallopt(M_MMAP_THRESHOLD, int(bytes_of_thread / 2));
  mallopt(M_TRIM_THRESHOLD, int(bytes_of_thread));
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
