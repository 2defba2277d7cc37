#include "calls/voxelize_call.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "jobs/job_counts.h"
#include "jobs/job_memory.h"
#include "jobs/prepare_kept.h"
#include "reply/raw_message.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// How often a waiting worker checks its deadline.
constexpr std::chrono::milliseconds kPollInterval{20};
// The shortest interval between progress messages within a stage.
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
    call->StartRead(&call->read_);
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
  const auto watch = [this](uint32_t limit_ms, const char* what) {
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
  v1::VoxelizeRequest request;
  absl::Status taken = ReadMessage(read_, request);
  if (taken.ok()) {
    const std::lock_guard lock(mutex_);  // the idle watch may end the call concurrently
    if (end_) return;
    taken = TakeMessage(request);
  }
  if (!taken.ok() || whole_) upload_wait_->End();
  if (!taken.ok()) {
    End(std::move(taken));
    return;
  }
  if (whole_) {
    SubmitJob();
    return;
  }
  if (record_.bytes_in - upload_bytes_seen_ >= kMinUploadBytes) {
    upload_bytes_seen_ = record_.bytes_in;
    upload_wait_->Begin();
  }
  StartRead(&read_);
}

absl::Status VoxelizeCall::TakeMessage(v1::VoxelizeRequest& request) {
  const auto take_bytes = [&](std::string bytes) {
    if (request.has_crc32c() &&
        Crc32c({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}) != request.crc32c()) {
      return absl::DataLossError(
          absl::StrCat("the CRC-32C of the mesh bytes from offset ", record_.bytes_in, " does not fit"));
    }
    return TakePiece(std::move(bytes));
  };
  switch (request.message_case()) {
    case v1::VoxelizeRequest::kConfig: return TakeConfig(request.config());
    case v1::VoxelizeRequest::kMeshPiece: return take_bytes(std::move(*request.mutable_mesh_piece()));
    case v1::VoxelizeRequest::kWhole: {
      if (absl::Status s = TakeConfig(request.whole().config()); !s.ok()) return s;
      whole_ = true;
      return take_bytes(std::move(*request.mutable_whole()->mutable_mesh()));
    }
    default: return absl::InvalidArgumentError("message: neither a config nor a mesh piece");
  }
}

absl::Status VoxelizeCall::TakeConfig(const v1::VoxelizeConfig& message) {
  if (configured_) return absl::InvalidArgumentError("config: only the first message may be one");
  configured_ = true;
  if (absl::Status s = ConfigureJob(state_, message, record_.client, *this); !s.ok()) return s;
  return state_.results.Admit(*this);  // before the upload of the mesh
}

absl::Status VoxelizeCall::TakePiece(std::string piece) {
  if (!configured_) return absl::InvalidArgumentError("config: must come before the mesh");
  if (piece.empty()) return absl::OkStatus();
  if (kept) {
    if (absl::Status s = CheckMeshBytes(*kept, config, record_.bytes_in + piece.size(), false); !s.ok()) return s;
  }
  if (absl::Status s = TakeUploadBytes(state_, record_.bytes_in, piece.size(), uploads_); !s.ok()) return s;
  if (absl::Status s = record_.TakeBytes(piece.size()); !s.ok()) return s;
  AppendPiece(std::move(piece), pieces);
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
  SubmitJob();
}

void VoxelizeCall::SubmitJob() {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    submitted_ = true;
  }
  if (absl::Status s = state_.results.Submit({self_, static_cast<VoxelizeJob*>(this)}); !s.ok()) {
    Done(std::move(s));
    return;
  }
  if (!context.Check().ok()) OnCancel();  // it may have come before the job could be withdrawn
}

absl::Status VoxelizeCall::Planned(const Plan& plan, bool may_wait) {
  uploads_.ShrinkTo(0);  // the file was freed after loading
  working_.ShrinkTo(0);  // of a failed worker
  if (absl::Status s = TakeMemory(plan, may_wait, context, working_); !s.ok()) return s;
  PlanShared(plan);
  return absl::OkStatus();
}

void VoxelizeCall::PlanShared(const Plan& plan) {
  if (std::exchange(planned_, true)) return;
  if (whole_ && plan.result_bytes <= kWholeBytes) {
    plan_ = plan;
  } else {
    v1::VoxelizeResponse response;
    *response.mutable_accepted() = ToMessage(plan);
    Post(response);
    whole_ = false;
    for (const v1::Progress& progress : early_) {
      v1::VoxelizeResponse news;
      *news.mutable_progress() = progress;
      Post(news);
    }
  }
  early_.clear();
}

void VoxelizeCall::DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) {
  state_.metrics.JobEnded(absl::StatusCode::kOk);
  kept.reset();
  PlanShared(plan);
  Answer(outcome, cached);
}

void VoxelizeCall::Done(absl::StatusOr<JobOutcome> outcome) {
  CountJob(state_.metrics, outcome);
  mesh.reset();
  kept.reset();
  if (!outcome.ok()) {
    {
      const std::lock_guard lock(mutex_);
      submitted_ = false;
      if (end_) FreeLocked();  // the call ended while the job still ran
    }
    End(outcome.status());
    return;
  }
  if (!outcome->streamed) {
    working_.ShrinkTo(ResultBytes(outcome->result));
    Answer(std::make_shared<const JobOutcome>(*std::move(outcome)), false);
    return;
  }
  grpc::ByteBuffer summary = pieces_made().Summary(*outcome);
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
    pending_.push_back(std::move(summary));
    record_.bytes_out = pieces_made().sent_bytes();
    record_.raw_bytes_out = pieces_made().bytes();
    record_.facts = Facts(*outcome);
    last_is_pending_ = true;
    if (end_) FreeLocked();
  }
  Pump();
}

void VoxelizeCall::Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached) {
  const PieceOptions options = PiecesOf(state_.options);
  std::shared_ptr<ResultStream> result;
  std::optional<grpc::ByteBuffer> message;
  uint64_t sent_bytes = 0, raw_bytes = 0;
  if (plan_ && ResultBytes(outcome->result) <= kWholeBytes) {
    ResultPieces whole(config.settings, options);
    whole.SetShared(cached, outcome->sums);
    message = whole.Whole(*plan_, outcome);
    sent_bytes = whole.sent_bytes();
    raw_bytes = whole.bytes();
  } else {
    if (plan_) {  // the plan did not have the size
      v1::VoxelizeResponse response;
      *response.mutable_accepted() = ToMessage(*plan_);
      Post(response);
    }
    result = std::make_shared<ResultStream>(outcome, config.settings, options, ResponseCoder(), cached);
  }
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
    if (end_) {
      FreeLocked();  // the call ended while the job still ran
    } else {
      record_.facts = Facts(*outcome);
      result_ = std::move(result);
      if (message) {
        record_.bytes_out = sent_bytes;
        record_.raw_bytes_out = raw_bytes;
        pending_.push_back(*std::move(message));
        last_is_pending_ = true;
      }
    }
  }
  Pump();
}

ResultPieces& VoxelizeCall::pieces_made() {
  if (!pieces_made_) pieces_made_.emplace(config.settings, PiecesOf(state_.options));
  return *pieces_made_;
}

absl::Status VoxelizeCall::Begin(const ResultHeader& header) {
  Post(pieces_made().Header(header));
  return absl::OkStatus();
}

absl::Status VoxelizeCall::Write(size_t array, std::span<const uint8_t> bytes) {
  while (!bytes.empty()) {
    const std::span<const uint8_t> piece = bytes.first(std::min<uint64_t>(pieces_made().piece_bytes(), bytes.size()));
    if (absl::Status s = WaitForRoom(piece.size()); !s.ok()) return s;
    Post(pieces_made().Piece(array, piece, nullptr));
    pieces_made().Hash(piece);
    bytes = bytes.subspan(piece.size());
  }
  return absl::OkStatus();
}

absl::Status VoxelizeCall::WaitForRoom(size_t bytes) {
  std::unique_lock lock(mutex_);
  // One piece may always be queued. Sweep ends the call of a client that reads nothing.
  while (!end_ && !pending_.empty() && pending_bytes_ + bytes > state_.options.stream_buffer_bytes) {
    if (absl::Status s = context.Check(); !s.ok()) return s;
    room_.wait_for(lock, kPollInterval);  // a passing deadline sends no notification
  }
  return end_ ? (end_->ok() ? absl::CancelledError("the call has ended") : *end_) : context.Check();
}

void VoxelizeCall::GiveUp(std::string_view why) {
  {
    const std::lock_guard lock(mutex_);
    if (finished_) end_ = absl::AbortedError(std::string(why));  // the client does not read the last message
  }
  End(absl::AbortedError(std::string(why)));
  bool writing;
  {
    const std::lock_guard lock(mutex_);
    writing = writing_ || finished_;
  }
  if (context.Check().ok()) context.Cancel();
  if (writing) HangUp();  // the call can finish only after that write
}

void VoxelizeCall::HangUp() {
  const std::lock_guard lock(context_mutex_);
  if (!context_gone_) context_.TryCancel();
}

void VoxelizeCall::OnProgress(std::string_view stage, double fraction) {
  if (whole_) return;  // sent in one message, or not before the plan
  if (!planned_) {     // the plan is sent first; of earlier progress, the last message of each stage follows it
    if (early_.empty() || early_.back().stage() != stage) early_.emplace_back().set_stage(std::string(stage));
    early_.back().set_fraction(fraction);
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  if (fraction > 0 && now - last_progress_ < kProgressInterval) return;
  last_progress_ = now;
  v1::VoxelizeResponse response;
  response.mutable_progress()->set_stage(std::string(stage));
  response.mutable_progress()->set_fraction(fraction);
  Post(response);
}

void VoxelizeCall::Post(const v1::VoxelizeResponse& response) {
  Post(ResponseCoder().Message(response));
}

void VoxelizeCall::Post(grpc::ByteBuffer message) {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    pending_bytes_ += message.Length();
    pending_.push_back(std::move(message));
  }
  Pump();
}

void VoxelizeCall::Pump() {
  std::unique_lock lock(mutex_);
  while (!making_ && !writing_ && !finished_) {
    if (end_) {
      finished_ = true;
      const grpc::Status status = ToGrpcStatus(*end_);
      lock.unlock();
      record_.Answered();
      Finish(status);
      return;
    }
    bool last = false;
    std::shared_ptr<ResultStream> result;
    std::shared_ptr<VoxelizeCall> keep;
    if (!pending_.empty()) {
      writing_message_.Swap(&pending_.front());
      pending_.pop_front();
      pending_bytes_ -= std::min(pending_bytes_, writing_message_.Length());
      last = last_is_pending_ && pending_.empty();
    } else if (result_) {
      // Made without the lock, because hashing and copying a piece take long. End does not touch the stream meanwhile.
      result = result_;
      keep = self_;
      making_ = true;
      lock.unlock();
      grpc::ByteBuffer message = result->Next();
      lock.lock();
      if (end_) {
        making_ = false;
        FreeLocked();
        continue;
      }
      writing_message_.Swap(&message);
      record_.bytes_out = result->sent_bytes();
      record_.raw_bytes_out = result->bytes();
      last = result->done();
    } else {
      return;  // the job continues
    }
    // No other thread starts a write or finishes now, so gRPC is called without the lock.
    if (last) {
      end_ = absl::OkStatus();
      finished_ = true;
      making_ = false;
      lock.unlock();
      write_wait_->Begin();
      record_.Answered();
      StartWriteAndFinish(&writing_message_, grpc::WriteOptions(), grpc::Status::OK);
      return;
    }
    writing_ = true;
    const grpc::WriteOptions options = write_ahead_.Next(result && result->next_is_ready());
    lock.unlock();
    write_wait_->Begin();
    StartWrite(&writing_message_, options);
    if (!result) return;
    result->CatchUp();  // while the piece is being sent
    lock.lock();
    making_ = false;  // if the write is already done, this thread starts the next one
    if (end_) FreeLocked();
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
    End(context.Check());  // the client is gone
    return;
  }
  Pump();
}

void VoxelizeCall::End(absl::Status status) {
  {
    const std::lock_guard lock(mutex_);
    if (!end_) end_ = std::move(status);
    pending_.clear();
    pending_bytes_ = 0;
    FreeLocked();
  }
  room_.notify_all();
  Pump();
}

void VoxelizeCall::FreeLocked() {
  if (submitted_ || making_) return;  // freed when the worker, or the thread that makes a message, is done
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
  if (submitted && state_.results.Withdraw(*this)) Done(context.Check());
}

void VoxelizeCall::OnDone() {
  std::shared_ptr<VoxelizeCall> keep;
  write_wait_->End();
  {
    const std::lock_guard lock(context_mutex_);
    context_gone_ = true;
  }
  {
    const std::lock_guard lock(mutex_);
    record_.Log(end_.value_or(absl::UnknownError("the call ended by itself")));
    FreeLocked();
    keep = std::move(self_);
  }
}

}  // namespace voxelpipe
