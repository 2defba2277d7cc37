#include "calls/voxelize_call.h"

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// How long a job waits for other jobs to free memory before its client is asked to come again.
constexpr std::chrono::milliseconds kMemoryPatience{20'000};
constexpr std::chrono::milliseconds kRetryDelay{1000};
// A waiting worker looks at its deadline so often.
constexpr std::chrono::milliseconds kLookEvery{20};
// Progress within a stage is not told more often.
constexpr std::chrono::milliseconds kProgressInterval{100};

std::string Facts(const JobOutcome& outcome) {
  const GridSpec& grid = outcome.result.grid;
  const VoxelizeStats& stats = outcome.result.stats;
  return absl::StrCat(" triangles=", stats.triangles, " dims=", grid.dims[0], "x", grid.dims[1], "x", grid.dims[2],
                      " occupied=", stats.occupied, " voxelize_ms=", stats.voxelize_ms, " peak=", outcome.peak_bytes);
}

}  // namespace

VoxelizeCall* VoxelizeCall::Create(ServiceState& state, grpc::CallbackServerContext& context) {
  std::shared_ptr<VoxelizeCall> call(new VoxelizeCall(state, context));
  call->self_ = call;
  if (call->pass_) {
    call->StartRead(&call->request_);
  } else {
    call->End(ShuttingDownError());
  }
  return call.get();
}

VoxelizeCall::VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& context)
    : state_(state),
      pass_(state.gate),
      context_(context),
      record_(state.next_request_id++, "Voxelize", context.peer()),
      job_([this](std::string_view stage, double fraction) { OnProgress(stage, fraction); }),
      uploads_(state.uploads),
      working_(state.working) {
  SetDeadline(context, job_);
}

void VoxelizeCall::OnReadDone(bool ok) {
  if (!ok) {
    UploadEnded();
    return;
  }
  if (absl::Status s = TakeMessage(); !s.ok()) {
    End(std::move(s));
    return;
  }
  StartRead(&request_);
}

absl::Status VoxelizeCall::TakeMessage() {
  switch (request_.message_case()) {
    case v1::VoxelizeRequest::kConfig: return TakeConfig(request_.config());
    case v1::VoxelizeRequest::kMeshPiece: return TakePiece(std::move(*request_.mutable_mesh_piece()));
    default: return absl::InvalidArgumentError("message: neither a config nor a mesh piece");
  }
}

absl::Status VoxelizeCall::TakeConfig(const v1::VoxelizeConfig& config) {
  if (config_) return absl::InvalidArgumentError("config: only the first message may be one");
  absl::StatusOr<ParsedConfig> parsed = ParseConfig(config);
  if (!parsed.ok()) return parsed.status();
  config_ = *std::move(parsed);
  return PrepareRequest(state_, config_->request);
}

absl::Status VoxelizeCall::TakePiece(std::string piece) {
  if (!config_) return absl::InvalidArgumentError("config: must come before the mesh");
  if (piece.empty()) return absl::OkStatus();
  if (piece.size() > state_.limits.load.max_file_bytes - record_.bytes_in) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh file is larger than the limit of ", state_.limits.load.max_file_bytes, " bytes"));
  }
  if (!uploads_.TryGrow(piece.size())) {
    return BusyError("too many meshes are being uploaded at the same time", kRetryDelay);
  }
  record_.bytes_in += piece.size();
  pieces_.push_back(std::move(piece));
  return absl::OkStatus();
}

void VoxelizeCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (job_.Check().ok()) job_.Cancel();
    End(job_.Check());
    return;
  }
  if (!config_) {
    End(absl::InvalidArgumentError("config: the stream ended without one"));
    return;
  }
  absl::StatusOr<WorkerPool::Ticket> ticket = state_.pool.Submit([self = self_] { self->Work(); });
  if (!ticket.ok()) {
    End(ticket.status());
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    ticket_ = *ticket;
  }
  if (!job_.Check().ok()) OnCancel();  // it may have come before there was a ticket
}

void VoxelizeCall::Work() {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    working_now_ = true;
  }
  absl::StatusOr<JobOutcome> outcome = absl::ResourceExhaustedError("out of memory for the mesh file");
  std::unique_ptr<ResultStream> result;
  try {
    std::vector<uint8_t> file;
    file.reserve(record_.bytes_in);
    for (; !pieces_.empty(); pieces_.pop_front())
      file.insert(file.end(), pieces_.front().begin(), pieces_.front().end());
    outcome = Run(std::move(file));
    if (outcome.ok() && outcome->streamed) {
      v1::VoxelizeResponse summary;
      pieces_made_.MakeSummary(*outcome, summary);
      Post(std::move(summary));
    } else if (outcome.ok()) {
      result = std::make_unique<ResultStream>(*std::move(outcome));
    }
  } catch (const std::bad_alloc&) {
    outcome = absl::ResourceExhaustedError("out of memory");
  }
  {
    const std::lock_guard lock(mutex_);
    working_now_ = false;
    record_.bytes_out = pieces_made_.bytes();
    if (end_) {
      FreeLocked();  // the call ended while the job still ran
    } else if (result) {
      record_.facts = Facts(result->outcome());
      result_ = std::move(result);
    } else if (outcome.ok()) {
      record_.facts = Facts(*outcome);
      streamed_ = true;
    }
  }
  if (!outcome.ok()) {
    End(outcome.status());
  } else {
    Pump();
  }
}

absl::StatusOr<JobOutcome> VoxelizeCall::Run(std::vector<uint8_t> file) {
  absl::StatusOr<JobOutcome> outcome = RunJob(
      std::move(file), *config_, state_.limits, job_, [this](const Plan& plan) { OnPlan(plan); }, this);
  if (refused_for_load_) return BusyError("the memory that this job needs is in use by others", kRetryDelay);
  if (!outcome.ok()) return outcome;
  uint64_t result_bytes = 0;
  for (const std::span<const uint8_t> array : ArraysOf(outcome->result)) result_bytes += array.size();
  working_.ShrinkTo(result_bytes);
  return outcome;
}

absl::Status VoxelizeCall::Begin(const ResultHeader& header) {
  v1::VoxelizeResponse response;
  ResultPieces::MakeHeader(header, response);
  Post(std::move(response));
  return absl::OkStatus();
}

absl::Status VoxelizeCall::Write(size_t array, std::span<const uint8_t> bytes) {
  while (!bytes.empty()) {
    if (absl::Status s = WaitForRoom(); !s.ok()) return s;
    const std::span<const uint8_t> piece = bytes.first(std::min<uint64_t>(kPieceBytes, bytes.size()));
    v1::VoxelizeResponse response;
    pieces_made_.MakePiece(array, piece, response);
    Post(std::move(response));
    bytes = bytes.subspan(piece.size());
  }
  return absl::OkStatus();
}

absl::Status VoxelizeCall::WaitForRoom() {
  const std::chrono::milliseconds patience(state_.options.stall_timeout_ms);
  std::unique_lock lock(mutex_);
  uint64_t seen = writes_done_;
  auto give_up = std::chrono::steady_clock::now() + patience;
  while (!end_ && pending_.size() >= kMaxPiecesInFlight) {
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    room_.wait_for(lock, kLookEvery);  // a deadline that passes is not notified
    const auto now = std::chrono::steady_clock::now();
    if (seen != std::exchange(seen, writes_done_)) {
      give_up = now + patience;
    } else if (now >= give_up) {
      lock.unlock();
      const absl::Status stalled =
          absl::AbortedError(absl::StrCat("the client took nothing of the result for ", patience.count(), " ms"));
      End(stalled);
      HangUp();  // a write is in flight, and only its end lets the call finish
      return stalled;
    }
  }
  return end_ ? (end_->ok() ? absl::CancelledError("the call is over") : *end_) : job_.Check();
}

void VoxelizeCall::HangUp() {
  const std::lock_guard lock(context_mutex_);
  if (!context_gone_) context_.TryCancel();
}

void VoxelizeCall::OnPlan(const Plan& plan) {
  uploads_.ShrinkTo(0);  // the file is gone since it was loaded
  v1::VoxelizeResponse response;
  *response.mutable_accepted() = ToMessage(plan);
  Post(std::move(response));
  if (!working_.Grow(plan.peak_bytes, job_, kMemoryPatience) && job_.Check().ok()) {
    refused_for_load_ = true;
    job_.Cancel();
  }
}

void VoxelizeCall::OnProgress(std::string_view stage, double fraction) {
  const auto now = std::chrono::steady_clock::now();
  if (fraction > 0 && now - last_progress_ < kProgressInterval) return;
  last_progress_ = now;
  v1::VoxelizeResponse response;
  response.mutable_progress()->set_stage(std::string(stage));
  response.mutable_progress()->set_fraction(fraction);
  Post(std::move(response));
}

void VoxelizeCall::Post(v1::VoxelizeResponse response) {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    pending_.push_back(std::move(response));
  }
  Pump();
}

void VoxelizeCall::Pump() {
  std::unique_lock lock(mutex_);
  if (writing_ || finished_) return;
  if (!end_) {
    if (!pending_.empty()) {
      response_ = std::move(pending_.front());
      pending_.pop_front();
      writing_ = true;
    } else if (streamed_) {
      end_ = absl::OkStatus();
    } else if (result_ && result_->Next(response_)) {
      writing_ = true;
    } else if (result_) {
      record_.bytes_out = result_->bytes_sent();
      FreeLocked();
      end_ = absl::OkStatus();
    } else {
      return;  // the job goes on
    }
  }
  finished_ = !writing_;
  // Claimed: from here on no other thread starts a write or finishes, so gRPC is called without the lock.
  const bool finish = finished_;
  const absl::Status status = finish ? *end_ : absl::OkStatus();
  lock.unlock();
  if (finish) {
    Finish(ToGrpcStatus(status));
  } else {
    StartWrite(&response_);
  }
}

void VoxelizeCall::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    ++writes_done_;
  }
  room_.notify_all();
  if (!ok) {
    if (job_.Check().ok()) job_.Cancel();
    End(job_.Check());  // nobody listens
    return;
  }
  Pump();
}

void VoxelizeCall::End(absl::Status status) {
  {
    const std::lock_guard lock(mutex_);
    if (!end_) end_ = std::move(status);
    pending_.clear();
    FreeLocked();
  }
  room_.notify_all();
  Pump();
}

void VoxelizeCall::FreeLocked() {
  if (working_now_) return;  // the worker frees when it ends
  if (result_) record_.bytes_out = result_->bytes_sent();
  result_.reset();
  pieces_.clear();
  uploads_.ShrinkTo(0);
  working_.ShrinkTo(0);
}

void VoxelizeCall::OnCancel() {
  if (job_.Check().ok()) job_.Cancel();
  std::optional<WorkerPool::Ticket> ticket;
  {
    const std::lock_guard lock(mutex_);
    ticket = ticket_;
  }
  if (ticket && state_.pool.Withdraw(*ticket)) End(job_.Check());
}

void VoxelizeCall::OnDone() {
  std::shared_ptr<VoxelizeCall> keep;
  {
    const std::lock_guard lock(context_mutex_);
    context_gone_ = true;
  }
  {
    const std::lock_guard lock(mutex_);
    record_.Log(end_.value_or(absl::UnknownError("the call ended by itself")));
    keep = std::move(self_);
  }
}

}  // namespace voxelpipe
