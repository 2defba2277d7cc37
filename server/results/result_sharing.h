// Equal jobs at the same time are run once, and their results may be kept for those that come later.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "jobs/voxelize_job.h"
#include "observe/metrics.h"
#include "results/result_cache.h"
#include "results/single_flight.h"
#include "schedule/byte_budget.h"
#include "schedule/scheduler.h"

namespace voxelpipe {

// Stands between the calls and the scheduler. Jobs are equal that ask for the same of the same kept mesh (RequestKey);
// they are answered by DoneShared, with the same object. A run that waits has the best place, priority and deadline of
// all who wait for it; where the queue takes no job of the one who came first, only that one is refused. All others go
// through: those with a file or with positions of their own, those with a queue time-out of their own, and those whose
// result does not stand in memory as a whole. Thread-safe; calls the jobs without locks.
class ResultSharing {
 public:
  struct Options {
    bool share = true;               // false: all go through, where nothing is kept either
    uint64_t cache_bytes = 0;        // 0: nothing is kept
    uint64_t piece_bytes = 1 << 20;  // of the results in one piece, as they are sent
    double least_ms = 0;             // predicted: less work is done again sooner than shared, unless results are kept
  };
  // All must outlive the object, but for `scheduler`, which may be made later and must end its tasks earlier.
  ResultSharing(Scheduler& scheduler, ByteBudget& working, Metrics& metrics, const Options& options);
  ~ResultSharing();
  ResultSharing(const ResultSharing&) = delete;
  ResultSharing& operator=(const ResultSharing&) = delete;

  // As Scheduler::Admit; a job that an equal one takes along needs no place of its own.
  absl::Status Admit(const VoxelizeJob& job) const;
  // As Scheduler::Submit. The job may be answered before this returns.
  absl::Status Submit(std::shared_ptr<VoxelizeJob> job);
  // As Scheduler::Withdraw; the work goes on while others wait for it, and stops when none does.
  bool Withdraw(VoxelizeJob& job);

  const ResultCache& cache() const { return cache_; }

 private:
  class Run;
  struct StageNews {
    std::string stage;
    double fraction;
  };
  using News = std::variant<Plan, StageNews>;
  using Flights = SingleFlight<const SharedResult, News>;

  using Time = Scheduler::Time;
  // One who waits for a flight.
  struct Waiter {
    const VoxelizeJob* job;
    FairQueue::Stand stand;
    std::optional<Time> deadline, queue_deadline;
    bool IsOver() const;
  };
  // All of them, and the run that serves them.
  struct Crowd {
    std::weak_ptr<Run> run;
    std::vector<Waiter> waiters;
  };

  void Answer(const std::shared_ptr<VoxelizeJob>& job, const Flights::Answer& result);
  // With mutex_ held. Out: who left.
  Waiter LeaveCrowd(const Flights::Flight& flight, const VoxelizeJob& job);
  // Tells the scheduler who waits for the flight's run.
  void TellWaiters(const Flights::Flight& flight);

  Scheduler& scheduler_;
  ByteBudget& working_;
  Metrics& metrics_;
  const bool on_;
  const uint64_t piece_bytes_;
  const double least_ms_;
  ResultCache cache_;
  Flights flights_;
  std::mutex mutex_;
  std::unordered_map<const VoxelizeJob*, Flights::Seat> seats_;  // of the jobs that wait for a flight
  std::unordered_map<const Flights::Flight*, Crowd> crowds_;
};

// What jobs have in common that may share a result: the mesh, everything that the result's bytes depend on, and who may
// run it. Empty where the job cannot share.
std::string RequestKey(const VoxelizeJob& job);

}  // namespace voxelpipe
