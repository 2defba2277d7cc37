// Runs concurrent equal jobs once, and may cache their results for later ones.
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

// Between the calls and the scheduler. Jobs are equal if they have the same request for the same stored mesh, or for
// the same placed ones (RequestKey); DoneShared gives them the same object. A waiting run has the best queue position,
// priority and deadline of all its jobs; if the queue refuses the first job, only that one fails. Other jobs are not
// shared: those with a file or new positions, those with a queue time-out of their own, those whose result is not in
// memory as a whole, and those whose result is exported, which only use and fill the cache.
// Thread-safe; calls the jobs without locks.
class ResultSharing {
 public:
  struct Options {
    bool share = true;               // false: no sharing, unless results are cached
    uint64_t cache_bytes = 0;        // 0: no cache
    uint64_t piece_bytes = 1 << 20;  // size of the pieces in which results are sent
    double least_ms = 0;             // predicted: less work is not worth sharing, unless results are cached
  };
  // All must outlive the object, except `scheduler`, which may be created later and must end its tasks earlier.
  ResultSharing(Scheduler& scheduler, ByteBudget& working, Metrics& metrics, const Options& options);
  ~ResultSharing();
  ResultSharing(const ResultSharing&) = delete;
  ResultSharing& operator=(const ResultSharing&) = delete;

  // Like Scheduler::Admit; a job that joins an equal one needs no place in the queue.
  absl::Status Admit(const VoxelizeJob& job) const;
  // Like Scheduler::Submit. The job may be answered before this returns. An exported one gets a cached result, if there
  // is one, in its `ready`.
  absl::Status Submit(std::shared_ptr<VoxelizeJob> job);
  // Like Scheduler::Withdraw; the run continues while other jobs wait for it, and stops when none does.
  bool Withdraw(VoxelizeJob& job);

  // Puts the result of an exported job into the cache, for equal ones: unless it was streamed or came from there.
  void Keep(const VoxelizeJob& job, const std::shared_ptr<JobOutcome>& outcome, const Plan& plan);

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
  // A job that waits for a flight.
  struct Waiter {
    const VoxelizeJob* job;
    FairQueue::Stand stand;
    std::optional<Time> deadline, queue_deadline;
    bool IsOver() const;
  };
  // All jobs of a flight, and its run.
  struct Crowd {
    std::weak_ptr<Run> run;
    std::vector<Waiter> waiters;
  };

  void Answer(const std::shared_ptr<VoxelizeJob>& job, const Flights::Answer& result);
  // With mutex_ held. Out: the job that left.
  Waiter LeaveCrowd(const Flights::Flight& flight, const VoxelizeJob& job);
  // Updates the scheduler's list of clients waiting for the flight's run.
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

// The key of jobs that may share a result: the meshes and where they are placed, everything that the result's bytes
// depend on, and the devices that may run it. Empty if the job cannot share.
std::string RequestKey(const VoxelizeJob& job);

}  // namespace voxelpipe
