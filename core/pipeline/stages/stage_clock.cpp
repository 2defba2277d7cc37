#include "pipeline/stages/stage_clock.h"

#include <tbb/task_arena.h>

#include <ctime>

namespace voxelpipe {
namespace {

// CPU time of the whole process: with one job at a time, that job's on all its threads. Of this thread where the run
// has no other: to ask for the process's takes microseconds in a server of many threads.
double CpuMs() {
  timespec t;
  const bool alone = tbb::this_task_arena::max_concurrency() == 1;
  clock_gettime(alone ? CLOCK_THREAD_CPUTIME_ID : CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

}  // namespace

double& StageClock::Find(const char* name) {
  for (auto& [known, ms] : stats_.stages) {
    if (known == name) return ms;
  }
  job_.Report(name, 0);
  return stats_.stages.emplace_back(name, 0.0).second;
}

void StageClock::Go() {
  if (!running_) cpu_begin_ = CpuMs();
  running_ = true;
}

void StageClock::Pause() {
  if (running_) stats_.voxelize_cpu_ms += CpuMs() - cpu_begin_;
  running_ = false;
}

}  // namespace voxelpipe
