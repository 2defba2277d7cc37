// The times of a run's stages.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "base/wall_clock.h"
#include "job/stats.h"

namespace voxelpipe {

// Runs one stage: asks first whether the job may go on, reports progress, keeps the time. CPU time is read anew only
// after a pause between stages: with many threads in the process that costs as much as a stage of a small job.
class StageClock {
 public:
  StageClock(const JobContext& job, VoxelizeStats& stats) : job_(job), stats_(stats) {}

  template <typename Stage>
  auto operator()(const char* name, Stage&& stage) -> decltype(stage()) {
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    (void)Find(name);
    const double wall = WallMs();
    Go();
    auto result = stage();
    const double ms = WallMs() - wall;
    stats_.voxelize_ms += ms;
    Find(name) += ms;  // anew: other stages may have begun meanwhile
    return result;
  }
  void Done(const char* name, double fraction) { job_.Report(name, fraction); }
  // What is done until the next stage does not count as CPU time.
  void Pause();

 private:
  // The stage's milliseconds so far; its beginning is reported.
  double& Find(const char* name);
  void Go();

  const JobContext& job_;
  VoxelizeStats& stats_;
  bool running_ = false;
  double cpu_begin_ = 0;
};

}  // namespace voxelpipe
