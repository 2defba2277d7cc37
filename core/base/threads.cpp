#include "base/threads.h"

#include <algorithm>
#include <map>
#include <memory>
#include <mutex>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "base/machine.h"

namespace voxelpipe {
namespace {

// The arena of the calling thread for a number of threads. Kept until the thread ends: creating an arena costs as much
// as a small run.
tbb::task_arena& ThreadArena(int threads) {
  const int cpus = CpuCount();  // more threads than CPUs only wait for each other
  const int size = threads > 0 ? std::min(threads, cpus) : cpus;
  // One for each size: a nested run must not destroy the arena that it runs in.
  static thread_local std::map<int, tbb::task_arena> arenas;
  return arenas.try_emplace(size, size).first->second;
}

}  // namespace

void RunOnThreads(int threads, const std::function<void()>& body) {
  ThreadArena(threads).execute(body);
}

void RunEachOnThreads(int threads, size_t count, const std::function<void(size_t)>& body) {
  RunOnThreads(threads, [&] {
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      // A run that waits for its own loops must not start another one meanwhile: its times would be wrong.
      tbb::this_task_arena::isolate([&] { body(i); });
    });
  });
}

void LimitThreadsToCpus() {
  static std::mutex mutex;
  // Never destroyed: loops may run until the process ends.
  static auto* const control = new std::unique_ptr<tbb::global_control>;
  const std::lock_guard lock(mutex);
  // The smallest of several holds, so the new one is created before the old one is destroyed.
  *control = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, size_t(CpuCount()));
}

}  // namespace voxelpipe
