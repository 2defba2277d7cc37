// One batch on one device, from the worker's hand to the last answer.
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
  int sharers = 1;     // workers that use the host's cores now, this one included
  PlanLimits limits;
  bool watched = false;  // true if another thread may Abandon it; costs a copy of each request
};

// Threads of one run: no more than its work is worth, `limit` (0: none) and the cores. A short one takes no more than
// its share of the cores: where all are busy, threads beyond them only wait for each other and for those that answer
// clients. A long one takes them all, since it will outlast who shares them now.
int ThreadsFor(double predicted_ms, int limit, int sharers, int cores);

// Runs jobs, gives each its answer, and keeps those that the device failed, for another one. A device may also never
// answer: then another thread abandons the run, and from then on nothing of the jobs is touched, whatever the worker's
// thread still does. So all that the device works on is the run's own (the mesh is shared), and the thread that runs it
// holds the run.
class DeviceRun {
 public:
  using Clock = JobContext::Clock;

  // `tasks`: at least one, every one a VoxelizeJob. `backend` lives as long as the process.
  DeviceRun(const Backend& backend, std::vector<std::shared_ptr<Task>> tasks, DeviceRunOptions options);
  ~DeviceRun();
  DeviceRun(const DeviceRun&) = delete;
  DeviceRun& operator=(const DeviceRun&) = delete;

  // On the worker's thread, once. Every job gets its Done but those that the device failed. Out of device memory, a
  // batch is run in halves, then one by one. Never throws.
  void Go();

  // ---- After Go or Abandon.
  struct Left {
    std::shared_ptr<Task> task;
    absl::Status failure;  // of the device (DeviceFailureOf says which); OK where the run was abandoned
  };
  // All tasks, those that have their answer and those that do not.
  const std::vector<std::shared_ptr<Task>>& answered() const { return answered_; }
  const std::vector<Left>& left() const { return left_; }
  // The same, away from an abandoned run: the thread that runs it may hold it for ever, and must not hold tasks with
  // it.
  std::vector<std::shared_ptr<Task>> TakeAnswered() { return std::exchange(answered_, {}); }
  std::vector<Left> TakeLeft() { return std::exchange(left_, {}); }
  bool any_result() const { return any_result_; }  // the device made one
  uint64_t launches() const { return stats_.launches.value_or(0); }

  // ---- From another thread while Go runs; only where it is watched.
  // Tells the device's copies of the jobs' contexts what their callers cancelled.
  void PassOnCancels();
  // How long the device has given no sign of life; zero while a job's own code is waited for (its client, memory,
  // loading).
  Clock::duration Silence(Clock::time_point now) const;
  // True if every job that waits for its answer was cancelled or is late.
  bool Unwanted() const;
  // Predicted time of its jobs together.
  std::chrono::milliseconds predicted() const { return predicted_; }
  // Takes the jobs away from the run, if Silence is still at least `silence`: true, and left() has those without an
  // answer.
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
  // Gives a job its end. Inside.
  void Answer(Member& member, absl::StatusOr<JobOutcome> outcome);
  // Fills answered_ and left_; `without_answer` is what those get that the device returned nothing for.
  void Sort(const absl::Status& without_answer);

  const Backend& backend_;
  DeviceRunOptions options_;  // threads: no more than the work is worth
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
