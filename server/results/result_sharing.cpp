#include "results/result_sharing.h"

#include <algorithm>
#include <utility>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include "absl/strings/str_cat.h"
#include "base/checksum/sha256.h"
#include "job/result.h"
#include "jobs/job_counts.h"
#include "jobs/job_memory.h"
#include "jobs/request_memory.h"
#include "results/result_sums.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

// Refuses results that would be streamed slab by slab: each job then makes and sends its own.
class RefusingSink final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader& /*header*/) override { return absl::AbortedError("too large to be shared"); }
  absl::Status Write(size_t /*array*/, std::span<const uint8_t> /*bytes*/) override {
    return absl::AbortedError("too large to be shared");
  }
};

std::string HashOf(const VoxelizeResult& result) {
  Sha256 hash;
  for (const auto array : ArraysOf(result)) hash.Update(array);
  return hash.HexDigest();
}

// Of placed meshes: every entry with all of its fields, which are of fixed length or preceded by it.
std::string KeyOf(const std::vector<PlacedStored>& list) {
  Sha256 hash;
  const auto add = [&hash](const void* bytes, size_t size) { hash.Update({static_cast<const uint8_t*>(bytes), size}); };
  const auto add_text = [&add](const std::string& text) {
    const uint64_t size = text.size();
    add(&size, sizeof size);
    add(text.data(), text.size());
  };
  for (const PlacedStored& placed : list) {
    add_text(placed.mesh);
    add_text(placed.name);
    add(placed.matrix.m, sizeof placed.matrix.m);
    const uint32_t numbers[] = {placed.label.value_or(0), uint32_t(placed.priority), placed.motion ? 1u : 0u};
    add(numbers, sizeof numbers);
    if (!placed.motion) continue;
    for (const Vec3d* vec : {&placed.motion->linear, &placed.motion->angular, &placed.motion->center}) {
      const double xyz[] = {vec->x, vec->y, vec->z};
      add(xyz, sizeof xyz);
    }
  }
  return absl::StrCat("placed/", hash.HexDigest());
}

// True if the error is about the run, and not about the request: then each job may run by itself.
bool IsOfTheRun(const absl::Status& status) {
  return absl::IsAborted(status) || absl::IsCancelled(status) || absl::IsDeadlineExceeded(status);
}

// True if a time is before another; an absent one is after all.
bool Earlier(const std::optional<Scheduler::Time>& a, const std::optional<Scheduler::Time>& b) {
  return a && (!b || *a < *b);
}

}  // namespace

// The one run of a flight.
class ResultSharing::Run final : public VoxelizeJob {
 public:
  Run(ResultSharing& sharing, std::shared_ptr<Flights::Flight> flight, const VoxelizeJob& like)
      : VoxelizeJob([this](std::string_view stage, double fraction) {
          sharing_.flights_.Tell(flight_, StageNews{std::string(stage), fraction});
        }),
        sharing_(sharing),
        flight_(std::move(flight)),
        memory_(std::make_shared<BudgetShare>(sharing.working_)) {
    memory = MakeRequestMemory(sharing.working_, context);
    config = like.config;
    limits = like.limits;
    store = like.store;
    kept = like.kept;
    traits = like.traits;
  }

  absl::Status Planned(const Plan& plan, bool may_wait) override {
    if (config.request.result == ResultKind::kDense && plan.slab_depth < plan.grid.dims[2]) {
      return absl::AbortedError("too large to be shared");
    }
    memory_->ShrinkTo(0);  // of a failed worker
    if (absl::Status s = TakeMemory(plan, may_wait, context, *memory_); !s.ok()) return s;
    plan_ = plan;
    sharing_.flights_.Tell(flight_, plan);
    return absl::OkStatus();
  }
  ResultSink* large_results() override { return &refuse_; }
  void Done(absl::StatusOr<JobOutcome> outcome) override {
    mesh.reset();
    if (!outcome.ok()) {
      sharing_.flights_.Land(flight_, outcome.status());
      return;
    }
    CountWork(sharing_.metrics_, *outcome);
    auto made = std::make_shared<JobOutcome>(*std::move(outcome));
    uint64_t bytes = 0;
    for (const auto array : ArraysOf(made->result)) bytes += array.size();
    memory_->ShrinkTo(bytes);
    // One reader hashes it while sending; several would each hash it.
    const bool shared = sharing_.flights_.waiting(flight_) > 1;
    if (shared || sharing_.cache_.enabled()) {
      made->sums = std::make_shared<ResultSums>(made->result, sharing_.piece_bytes_);
      if (shared && config.settings.content_hash) made->sums->SetSha256(HashOf(made->result));
    }
    auto result = std::make_shared<const SharedResult>(SharedResult{std::move(made), plan_, memory_});
    if (sharing_.cache_.enabled()) sharing_.cache_.Put(flight_->key, *result);
    sharing_.flights_.Land(flight_, std::move(result));
  }

 private:
  ResultSharing& sharing_;
  const std::shared_ptr<Flights::Flight> flight_;
  const std::shared_ptr<BudgetShare> memory_;
  Plan plan_;
  RefusingSink refuse_;
};

ResultSharing::ResultSharing(Scheduler& scheduler, ByteBudget& working, Metrics& metrics, const Options& options)
    : scheduler_(scheduler),
      working_(working),
      metrics_(metrics),
      on_(options.share || options.cache_bytes > 0),
      piece_bytes_(options.piece_bytes),
      least_ms_(options.cache_bytes > 0 ? 0 : options.least_ms),
      cache_(options.cache_bytes) {}

ResultSharing::~ResultSharing() = default;

absl::Status ResultSharing::Admit(const VoxelizeJob& job) const {
  absl::Status status = scheduler_.Admit(job.traits);
  if (status.ok() || !on_ || job.exported || job.traits.cost.run_ms < least_ms_) return status;
  const std::string key = RequestKey(job);
  return !key.empty() && flights_.IsFlying(key) ? absl::OkStatus() : status;
}

absl::Status ResultSharing::Submit(std::shared_ptr<VoxelizeJob> job) {
  if (job->exported) {
    const std::string key = cache_.enabled() ? RequestKey(*job) : std::string();
    if (const auto result = key.empty() ? nullptr : cache_.Use(key)) {
      job->ready = result->outcome;
      job->ready_plan = result->plan;
    }
    return scheduler_.Submit(std::move(job));
  }
  const bool may_share = on_ && job->traits.cost.run_ms >= least_ms_;
  const std::string key = may_share ? RequestKey(*job) : std::string();
  if (key.empty()) return scheduler_.Submit(std::move(job));
  if (cache_.enabled()) {
    if (const std::shared_ptr<const SharedResult> result = cache_.Use(key)) {
      job->DoneShared(result->outcome, result->plan, true);
      return absl::OkStatus();
    }
  }
  Flights::Seat seat;
  std::shared_ptr<Run> run;
  {
    // Callbacks of the flight, and Withdraw, look up the seat, and so wait until it exists and the job was copied.
    const std::lock_guard lock(mutex_);
    seat = flights_.Join(key, {.done = [this, job](const Flights::Answer& result) { Answer(job, result); },
                               .news =
                                   [job](const News& news) {
                                     if (const auto* plan = std::get_if<Plan>(&news)) {
                                       job->PlanShared(*plan);
                                     } else if (const auto* stage = std::get_if<StageNews>(&news)) {
                                       job->context.Report(stage->stage, stage->fraction);
                                     }
                                   }});
    seats_[job.get()] = seat;
    Crowd& crowd = crowds_[seat.flight.get()];
    Waiter waiter{
        job.get(), {job->traits.client, job->traits.priority}, job->traits.deadline, scheduler_.QueueDeadline()};
    const bool covered = std::any_of(crowd.waiters.rbegin(), crowd.waiters.rend(), [&](const Waiter& other) {
      return other.stand == waiter.stand && !Earlier(other.deadline, waiter.deadline) &&
             !Earlier(other.queue_deadline, waiter.queue_deadline);
    });
    crowd.waiters.push_back(std::move(waiter));
    if (seat.first) {
      run = std::make_shared<Run>(*this, seat.flight, *job);
      crowd.run = run;
    } else if (!covered) {
      TellWaiters(*seat.flight);
    }
  }
  if (!seat.first) return absl::OkStatus();
  flights_.WhenEmpty(seat.flight, [this, weak = std::weak_ptr<Run>(run)] {
    if (const auto alive = weak.lock()) {
      alive->context.Cancel();
      scheduler_.Withdraw(*alive);
    }
  });
  const absl::Status submitted = scheduler_.Submit(run);
  if (submitted.ok()) {
    const std::lock_guard lock(mutex_);
    const auto crowd = crowds_.find(seat.flight.get());
    // Others may have joined before the scheduler had the run.
    if (crowd != crowds_.end() && crowd->second.waiters.size() > 1) TellWaiters(*seat.flight);
    return absl::OkStatus();
  }
  // The queue refused it for this client's share or this job's deadline. Jobs that joined meanwhile submit runs of
  // their own.
  const bool left = flights_.Leave(seat);
  if (left) {
    const std::lock_guard lock(mutex_);
    seats_.erase(job.get());
    LeaveCrowd(*seat.flight, *job);
  }
  flights_.Land(seat.flight, absl::AbortedError("the first one was refused"));
  return left ? submitted : absl::OkStatus();  // otherwise it was withdrawn meanwhile
}

bool ResultSharing::Waiter::IsOver() const {
  const Time now = JobContext::Clock::now();
  return (deadline && *deadline <= now) || (queue_deadline && *queue_deadline <= now);
}

ResultSharing::Waiter ResultSharing::LeaveCrowd(const Flights::Flight& flight, const VoxelizeJob& job) {
  const auto crowd = crowds_.find(&flight);
  std::vector<Waiter>& waiters = crowd->second.waiters;
  const auto found = std::find_if(waiters.begin(), waiters.end(), [&](const Waiter& w) { return w.job == &job; });
  Waiter waiter = std::move(*found);
  waiters.erase(found);
  if (waiters.empty()) crowds_.erase(crowd);
  return waiter;
}

void ResultSharing::TellWaiters(const Flights::Flight& flight) {
  const auto crowd = crowds_.find(&flight);
  if (crowd == crowds_.end()) return;
  const std::shared_ptr<Run> run = crowd->second.run.lock();
  if (!run) return;
  const std::vector<Waiter>& waiters = crowd->second.waiters;
  Scheduler::Waiters all{{}, waiters.front().deadline, waiters.front().queue_deadline};
  for (const Waiter& waiter : waiters) {
    if (Earlier(all.deadline, waiter.deadline)) all.deadline = waiter.deadline;
    if (Earlier(all.queue_deadline, waiter.queue_deadline)) all.queue_deadline = waiter.queue_deadline;
    if (std::find(all.stands.begin(), all.stands.end(), waiter.stand) == all.stands.end()) {
      all.stands.push_back(waiter.stand);
    }
  }
  std::stable_sort(all.stands.begin(), all.stands.end(),
                   [](const FairQueue::Stand& a, const FairQueue::Stand& b) { return a.priority < b.priority; });
  scheduler_.SetWaiters(*run, std::move(all));
}

void ResultSharing::Answer(const std::shared_ptr<VoxelizeJob>& job, const Flights::Answer& result) {
  bool first, over;
  {
    const std::lock_guard lock(mutex_);
    const auto seat = seats_.find(job.get());
    first = seat->second.first;
    over = LeaveCrowd(*seat->second.flight, *job).IsOver();
    seats_.erase(seat);
  }
  if (result.ok()) {
    if (!first) metrics_.jobs_shared.Increment();
    // The outcome, with its charge to the server's memory.
    job->DoneShared({*result, (*result)->outcome.get()}, (*result)->plan, !first);
  } else if (!IsOfTheRun(result.status()) || (over && absl::IsDeadlineExceeded(result.status()))) {
    job->Done(result.status());
  } else if (absl::Status s = scheduler_.Submit(job); !s.ok()) {
    job->Done(s);
  }
}

void ResultSharing::Keep(const VoxelizeJob& job, const std::shared_ptr<JobOutcome>& outcome, const Plan& plan) {
  if (!cache_.enabled() || outcome->streamed || job.ready) return;
  const std::string key = RequestKey(job);
  if (key.empty()) return;
  outcome->sums = std::make_shared<ResultSums>(outcome->result, piece_bytes_);
  cache_.Put(key, {outcome, plan, nullptr});
}

bool ResultSharing::Withdraw(VoxelizeJob& job) {
  Flights::Seat seat;
  {
    const std::lock_guard lock(mutex_);
    const auto found = seats_.find(&job);
    if (found != seats_.end()) seat = found->second;
  }
  if (!seat.flight) return scheduler_.Withdraw(job);
  if (!flights_.Leave(seat)) return false;  // it is already being answered
  const std::lock_guard lock(mutex_);
  seats_.erase(&job);
  LeaveCrowd(*seat.flight, job);
  TellWaiters(*seat.flight);
  return true;
}

std::string RequestKey(const VoxelizeJob& job) {
  const ParsedConfig& config = job.config;
  if (job.kept.empty() || config.new_positions || config.settings.queue_timeout) return {};
  CallSettings settings = config.settings;
  // Of the messages, which each call makes for itself.
  settings.compression = Compression::kNone;
  settings.content_hash = true;
  settings.single_message_bytes.reset();
  settings.priority = Priority::kNormal;  // the run has the best one of all waiting jobs
  std::string key = config.placed ? KeyOf(*config.placed) : job.kept.front()->name();
  {
    google::protobuf::io::StringOutputStream out(&key);  // appends
    google::protobuf::io::CodedOutputStream coded(&out);
    coded.SetSerializationDeterministic(true);
    MakeRequest(config.request, settings).SerializeToCodedStream(&coded);
  }
  return key;
}

}  // namespace voxelpipe
