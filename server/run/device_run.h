// One batch on one device, from the worker to the last response.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "jobs/voxelize_job.h"
#include "pipeline/batch.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

struct DeviceRunOptions {
  std::string worker;  // "cuda:0/1"
  int threads = 0;     // of the whole batch on the host; 0 = all
  int sharers = 1;     // workers that currently use the host's cores, including this one
  PlanLimits limits;
  bool watched = false;  // true if another thread may Abandon it; costs a copy of each request
};

// Threads of one run: at most as many as its work justifies, `limit` (0: none) and the cores. A short run takes at most
// its share of the cores: if all are busy, more threads only wait for each other and for those that serve clients. A
// long run takes all cores, because it will outlast the runs that share them now.
int ThreadsFor(double predicted_ms, int limit, int sharers, int cores);

// Runs jobs, answers each, and keeps those on which the device failed for another device. If a device hangs, another
// thread abandons the run; then the worker's thread accesses nothing of the jobs any more. So the run owns everything
// that the device works on (the mesh is shared), and the thread that runs it holds the run.
class DeviceRun {
 public:
  using Clock = JobContext::Clock;

  // `tasks`: at least one, all of class VoxelizeJob. `backend` lives as long as the process.
  DeviceRun(const Backend& backend, std::vector<std::shared_ptr<Task>> tasks, DeviceRunOptions options);
  ~DeviceRun();
  DeviceRun(const DeviceRun&) = delete;
  DeviceRun& operator=(const DeviceRun&) = delete;

  // On the worker's thread, once. Calls Done of every job, except those on which the device failed. If device memory is
  // short, a batch runs in halves, then one by one. Never throws.
  void Go();

  // ---- After Go or Abandon.
  struct Left {
    std::shared_ptr<Task> task;
    absl::Status failure;  // of the device (its kind: DeviceFailureOf); OK if the run was abandoned
  };
  // All tasks, answered or not.
  const std::vector<std::shared_ptr<Task>>& answered() const { return answered_; }
  const std::vector<Left>& left() const { return left_; }
  // The same, moved out of an abandoned run, which its thread may hold forever, so that it does not hold the tasks.
  std::vector<std::shared_ptr<Task>> TakeAnswered() { return std::exchange(answered_, {}); }
  std::vector<Left> TakeLeft() { return std::exchange(left_, {}); }
  bool any_result() const { return any_result_; }  // true if the device completed a result
  uint64_t launches() const { return stats_.launches.value_or(0); }

  // ---- From another thread while Go runs; only if it is watched. Forwards cancellations of callers to the run's
  // copies of the jobs' contexts.
  void PassOnCancels();
  // How long the device has made no progress; zero while the run waits for a job's own code (its client, memory,
  // loading).
  Clock::duration Silence(Clock::time_point now) const;
  // True if every unanswered job was cancelled or is past its deadline.
  bool Unwanted() const;
  // Predicted total time of its jobs.
  std::chrono::milliseconds predicted() const { return predicted_; }
  // Removes the jobs from the run if Silence is still at least `silence`: then true, and left() has the unanswered
  // ones.
  bool Abandon(Clock::time_point now, Clock::duration silence);

 private:
  struct Member;
  class Inside;
  class Sink;

  void Prepare();
  void RunSome(std::span<Member* const> members);
  void RunAlone(Member& member);
  void RunTogether(std::span<Member* const> members);
  absl::Status Planned(Member& member, const Plan& plan, bool together);
  void Take(Member& member, absl::StatusOr<JobOutcome> outcome);
  void TakeOfBatch(Member& member, absl::StatusOr<VoxelizeResult> result, uint32_t jobs);
  // Ends a job. Inside.
  void Answer(Member& member, absl::StatusOr<JobOutcome> outcome);
  // Fills answered_ and left_; `without_answer` is the status of jobs for which the device returned nothing.
  void Sort(const absl::Status& without_answer);

  const Backend& backend_;
  DeviceRunOptions options_;  // threads: limited by the work
  const JobLimits limits_;
  std::vector<std::unique_ptr<Member>> members_;
  std::chrono::milliseconds predicted_{0};
  bool tiny_jobs_ = false;
  BatchStats stats_;

  mutable std::mutex mutex_;
  int inside_ = 0;  // calls of jobs' code
  Clock::time_point sign_of_life_ = Clock::now();
  bool abandoned_ = false;
  bool any_result_ = false;
  std::vector<std::shared_ptr<Task>> answered_;
  std::vector<Left> left_;
};

}  // namespace voxelpipe
