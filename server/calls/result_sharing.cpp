#include "calls/result_sharing.h"

#include <utility>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include "absl/strings/str_cat.h"
#include "calls/job_setup.h"
#include "pipeline/result.h"
#include "wire/request.h"
#include "work/result_sums.h"
#include "work/sha256.h"

namespace voxelpipe {
namespace {

// Refuses what would leave slab by slab: each who asks then makes and sends it alone.
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

// Whether the error is about the run, and not about the request: then each may try for itself.
bool IsOfTheRun(const absl::Status& status) {
  return absl::IsAborted(status) || absl::IsCancelled(status) || absl::IsDeadlineExceeded(status);
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
    memory_->ShrinkTo(0);  // of a worker that failed
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
    // Where one reads it first, it is hashed while it is sent; several would each do so.
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

absl::Status ResultSharing::Submit(std::shared_ptr<VoxelizeJob> job) {
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
    // What the flight calls, and Withdraw, look for the seat, and so wait until it is there and the job was copied.
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
    if (seat.first) run = std::make_shared<Run>(*this, seat.flight, *job);
  }
  if (!seat.first) return absl::OkStatus();
  flights_.WhenEmpty(seat.flight, [this, weak = std::weak_ptr<Run>(run)] {
    if (const auto alive = weak.lock()) {
      alive->context.Cancel();
      scheduler_.Withdraw(*alive);
    }
  });
  // Others may have joined by now: they hear of a full queue, too.
  if (absl::Status s = scheduler_.Submit(run); !s.ok()) flights_.Land(seat.flight, s);
  return absl::OkStatus();
}

void ResultSharing::Answer(const std::shared_ptr<VoxelizeJob>& job, const Flights::Answer& result) {
  bool first;
  {
    const std::lock_guard lock(mutex_);
    const auto seat = seats_.find(job.get());
    first = seat->second.first;
    seats_.erase(seat);
  }
  if (result.ok()) {
    if (!first) metrics_.jobs_shared.Increment();
    // The outcome, and with it what it holds of the server's memory.
    job->DoneShared({*result, (*result)->outcome.get()}, (*result)->plan, !first);
  } else if (!IsOfTheRun(result.status())) {
    job->Done(result.status());
  } else if (absl::Status s = scheduler_.Submit(job); !s.ok()) {
    job->Done(s);
  }
}

bool ResultSharing::Withdraw(VoxelizeJob& job) {
  Flights::Seat seat;
  {
    const std::lock_guard lock(mutex_);
    const auto found = seats_.find(&job);
    if (found != seats_.end()) seat = found->second;
  }
  if (!seat.flight) return scheduler_.Withdraw(job);
  if (!flights_.Leave(seat)) return false;  // it is being answered
  const std::lock_guard lock(mutex_);
  seats_.erase(&job);
  return true;
}

std::string RequestKey(const VoxelizeJob& job) {
  const ParsedConfig& config = job.config;
  if (!job.kept || config.new_positions || config.settings.queue_timeout) return {};
  CallSettings settings = config.settings;
  settings.compression = Compression::kNone;  // of the pieces, which each makes for itself
  settings.content_hash = true;
  std::string key = job.kept->id();
  {
    google::protobuf::io::StringOutputStream out(&key);  // appends
    google::protobuf::io::CodedOutputStream coded(&out);
    coded.SetSerializationDeterministic(true);
    MakeConfig(config.request, config.mesh_format, settings).SerializeToCodedStream(&coded);
  }
  return key;
}

}  // namespace voxelpipe
