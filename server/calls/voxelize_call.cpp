#include "calls/voxelize_call.h"

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "meshes/prepare_kept.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kRetryDelay{1000};
// A waiting worker looks at its deadline so often.
constexpr std::chrono::milliseconds kLookEvery{20};
// Progress within a stage is not told more often.
constexpr std::chrono::milliseconds kProgressInterval{100};

}  // namespace

VoxelizeCall* VoxelizeCall::Create(ServiceState& state, grpc::CallbackServerContext& context) {
  std::shared_ptr<VoxelizeCall> call(new VoxelizeCall(state, context));
  call->self_ = call;
  call->WatchForIdleness();
  if (absl::Status status = MayBegin(call->pass_, call->record_); !status.ok()) {
    call->End(std::move(status));
  } else {
    call->upload_wait_->Begin();
    call->StartRead(&call->request_);
  }
  return call.get();
}

VoxelizeCall::VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& grpc_context)
    : VoxelizeJob([this](std::string_view stage, double fraction) { OnProgress(stage, fraction); }),
      state_(state),
      pass_(state.gate),
      context_(grpc_context),
      record_(state, grpc_context, Rpc::kVoxelize),
      uploads_(state.uploads),
      working_(state.working) {
  SetDeadline(grpc_context, context);
}

void VoxelizeCall::WatchForIdleness() {
  const auto watch = [this](uint32_t limit_ms, std::string what) {
    const std::string why = absl::StrCat("the client ", what, " for ", limit_ms, " ms");
    return std::make_unique<IdleWatch::Wait>(state_.idle_watch, std::chrono::milliseconds(limit_ms),
                                             [call = std::weak_ptr<VoxelizeCall>(self_), why] {
                                               if (const auto self = call.lock()) self->GiveUp(why);
                                             });
  };
  upload_wait_ = watch(state_.options.upload_idle_timeout_ms, "sent too little of its mesh");
  write_wait_ = watch(state_.options.stall_timeout_ms, "took nothing of the answer");
}

void VoxelizeCall::OnReadDone(bool ok) {
  if (!ok) {
    upload_wait_->End();
    UploadEnded();
    return;
  }
  absl::Status taken;
  {
    const std::lock_guard lock(mutex_);  // the watch may end the call meanwhile
    if (end_) return;
    taken = TakeMessage();
  }
  if (!taken.ok()) {
    upload_wait_->End();
    End(std::move(taken));
    return;
  }
  if (record_.bytes_in - upload_bytes_seen_ >= kLeastUploadBytes) {
    upload_bytes_seen_ = record_.bytes_in;
    upload_wait_->Begin();
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

absl::Status VoxelizeCall::TakeConfig(const v1::VoxelizeConfig& message) {
  if (configured_) return absl::InvalidArgumentError("config: only the first message may be one");
  configured_ = true;
  return ConfigureJob(state_, message, record_.client, *this);
}

absl::Status VoxelizeCall::TakePiece(std::string piece) {
  if (!configured_) return absl::InvalidArgumentError("config: must come before the mesh");
  if (piece.empty()) return absl::OkStatus();
  if (kept) {
    if (absl::Status s = CheckMeshBytes(*kept, config, record_.bytes_in + piece.size(), false); !s.ok()) return s;
  }
  if (piece.size() > state_.limits.load.max_file_bytes - record_.bytes_in) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh file is larger than the limit of ", state_.limits.load.max_file_bytes, " bytes"));
  }
  if (!uploads_.TryGrow(piece.size())) {
    return BusyError("too many meshes are being uploaded at the same time", kRetryDelay);
  }
  if (absl::Status s = record_.TakeBytes(piece.size()); !s.ok()) return s;
  pieces.push_back(std::move(piece));
  return absl::OkStatus();
}

void VoxelizeCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (context.Check().ok()) context.Cancel();
    End(context.Check());
    return;
  }
  if (!configured_) {
    End(absl::InvalidArgumentError("config: the stream ended without one"));
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    submitted_ = true;
  }
  if (absl::Status s = state_.scheduler.Submit({self_, static_cast<Task*>(this)}); !s.ok()) {
    Done(std::move(s));
    return;
  }
  if (!context.Check().ok()) OnCancel();  // it may have come before the job could be withdrawn
}

absl::Status VoxelizeCall::Planned(const Plan& plan, bool may_wait) {
  uploads_.ShrinkTo(0);  // the file is gone since it was loaded
  if (absl::Status s = TakeMemory(plan, may_wait, context, working_); !s.ok()) return s;
  v1::VoxelizeResponse response;
  *response.mutable_accepted() = ToMessage(plan);
  Post(std::move(response));
  return absl::OkStatus();
}

void VoxelizeCall::Done(absl::StatusOr<JobOutcome> outcome) {
  mesh.reset();
  kept.reset();
  std::unique_ptr<ResultStream> result;
  if (outcome.ok() && outcome->streamed) {
    v1::VoxelizeResponse summary;
    pieces_made_.MakeSummary(*outcome, summary);
    Post(std::move(summary));
  } else if (outcome.ok()) {
    uint64_t result_bytes = 0;
    for (const std::span<const uint8_t> array : ArraysOf(outcome->result)) result_bytes += array.size();
    working_.ShrinkTo(result_bytes);
    result = std::make_unique<ResultStream>(*std::move(outcome));
  }
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
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
  std::unique_lock lock(mutex_);
  while (!end_ && pending_.size() >= kMaxPiecesInFlight) {
    if (absl::Status s = context.Check(); !s.ok()) return s;
    room_.wait_for(lock, kLookEvery);  // a deadline that passes is not notified
  }
  return end_ ? (end_->ok() ? absl::CancelledError("the call is over") : *end_) : context.Check();
}

void VoxelizeCall::GiveUp(std::string_view why) {
  End(absl::AbortedError(std::string(why)));
  bool writing;
  {
    const std::lock_guard lock(mutex_);
    writing = writing_;
  }
  if (context.Check().ok()) context.Cancel();
  if (writing) HangUp();  // only the end of that write lets the call finish
}

void VoxelizeCall::HangUp() {
  const std::lock_guard lock(context_mutex_);
  if (!context_gone_) context_.TryCancel();
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
    write_wait_->Begin();
    StartWrite(&response_);
  }
}

void VoxelizeCall::OnWriteDone(bool ok) {
  write_wait_->End();
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
  }
  room_.notify_all();
  if (!ok) {
    if (context.Check().ok()) context.Cancel();
    End(context.Check());  // nobody listens
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
  if (submitted_) return;  // freed when the worker is done
  if (result_) record_.bytes_out = result_->bytes_sent();
  result_.reset();
  pieces.clear();
  uploads_.ShrinkTo(0);
  working_.ShrinkTo(0);
}

void VoxelizeCall::OnCancel() {
  if (context.Check().ok()) context.Cancel();
  bool submitted;
  {
    const std::lock_guard lock(mutex_);
    submitted = submitted_;
  }
  if (submitted && state_.scheduler.Withdraw(*this)) Done(context.Check());
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
