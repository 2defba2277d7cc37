#include "calls/result_call.h"

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "jobs/job_counts.h"
#include "jobs/job_memory.h"
#include "jobs/prepare_kept.h"
#include "jobs/request_memory.h"
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

ResultCall::ResultCall(ServiceState& state, grpc::CallbackServerContext& grpc_context, Rpc rpc)
    : VoxelizeJob([this](std::string_view stage, double fraction) { OnProgress(stage, fraction); }),
      state_(state),
      pass_(state.gate),
      context_(grpc_context),
      record_(state, grpc_context, rpc),
      make_export_(state.exports.Take(std::string(MetadataOf(grpc_context, ResultExports::kKey).value_or("")))),
      uploads_(state.uploads),
      working_(state.working) {
  SetDeadline(grpc_context, context);
}

void ResultCall::KeepAlive(std::shared_ptr<ResultCall> self) {
  self_ = std::move(self);
  write_wait_ = WaitForClient(state_.options.stall_timeout_ms, "took nothing of the answer");
}

std::unique_ptr<IdleWatch::Wait> ResultCall::WaitForClient(uint32_t limit_ms, const char* what) {
  return std::make_unique<IdleWatch::Wait>(
      state_.idle_watch, std::chrono::milliseconds(limit_ms),
      [call = std::weak_ptr<ResultCall>(self_), limit_ms, what] {
        if (const auto self = call.lock()) self->GiveUp(absl::StrCat("the client ", what, " for ", limit_ms, " ms"));
      });
}

absl::Status ResultCall::TakeRequest(v1::VoxelizeRequest& message) {
  if (configured_) return absl::InvalidArgumentError("request: only the first message may be one");
  configured_ = true;
  if (absl::Status s = ConfigureJob(state_, message, record_.client, *this); !s.ok()) return s;
  if (make_export_) {
    absl::StatusOr<std::unique_ptr<ResultExport>> made = make_export_(config, context);
    if (!made.ok()) return made.status();
    exported = *std::move(made);
    config.settings.content_hash = false;  // no bytes are sent
    Weigh();
  }
  if (absl::Status s = state_.results.Admit(*this); !s.ok()) return s;  // before the upload of the mesh
  if (absl::Status s = TakeListBytes(config, uploads_); !s.ok()) return s;
  const MeshData data = MeshDataOf(message);
  return data.bytes == nullptr ? absl::OkStatus() : TakePiece(std::move(*data.bytes), data.crc32c);
}

absl::Status ResultCall::TakePiece(std::string piece, std::optional<uint32_t> crc32c) {
  if (absl::Status s = CheckMeshCrc(piece, crc32c, record_.bytes_in); !s.ok()) return s;
  if (!configured_) return absl::InvalidArgumentError("request: must come before the mesh");
  if (piece.empty()) return absl::OkStatus();
  if (!kept.empty()) {
    if (absl::Status s = CheckMeshBytes(kept, config, record_.bytes_in + piece.size(), false); !s.ok()) return s;
  }
  if (absl::Status s = TakeUploadBytes(state_, record_.bytes_in, piece.size(), uploads_); !s.ok()) return s;
  if (absl::Status s = record_.TakeBytes(piece.size()); !s.ok()) return s;
  AppendPiece(std::move(piece), pieces);
  return absl::OkStatus();
}

void ResultCall::SubmitJob() {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    submitted_ = true;
  }
  if (absl::Status s = state_.results.Submit({self_, static_cast<VoxelizeJob*>(this)}); !s.ok()) {
    Done(std::move(s));
    return;
  }
  if (!context.Check().ok()) Cancelled();  // it may have come before the job could be withdrawn
}

absl::Status ResultCall::Planned(const Plan& plan, bool may_wait) {
  // The others of a batch would wait for its export.
  if (exported && !may_wait) return absl::AbortedError("an exported result is made alone");
  if (exported) export_plan_ = plan;
  uploads_.ShrinkTo(0);  // the file was freed after loading
  working_.ShrinkTo(0);  // of a failed worker
  if (absl::Status s = TakeMemory(plan, may_wait, context, working_); !s.ok()) return s;
  PlanShared(plan);
  return absl::OkStatus();
}

void ResultCall::PlanShared(const Plan& plan) {
  if (std::exchange(planned_, true)) return;
  if (IsOneMessage(plan.result_bytes)) {
    gathers_ = true;
    plan_ = plan;
    last_progress_ = std::chrono::steady_clock::now();
  } else {
    PostPlan(plan);
    for (const v1::Progress& progress : early_) PostProgress(progress);
  }
  early_.clear();
}

void ResultCall::PostPlan(const Plan& plan) {
  if (!sends_progress()) return;
  v1::VoxelizeResponse response;
  WriteTo(plan, *response.mutable_plan());
  Post(ResponseCoder().Message(response));
}

void ResultCall::DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) {
  if (exported) {
    PlanShared(plan);
    const absl::Status status = Export(*outcome);
    state_.metrics.JobEnded(status.code());
    AnswerExport(status, *outcome, cached);
    return;
  }
  state_.metrics.JobEnded(absl::StatusCode::kOk);
  FreeMesh();
  PlanShared(plan);
  Answer(outcome, cached);
}

void ResultCall::Done(absl::StatusOr<JobOutcome> outcome) {
  if (outcome.ok() && outcome->streamed && gathers_) {
    VoxelizeResult gathered = gathered_.Take();
    gathered.stats = std::move(outcome->result.stats);
    outcome->result = std::move(gathered);
    outcome->streamed = false;
  }
  if (outcome.ok() && exported) {
    DoneExport(std::make_shared<JobOutcome>(*std::move(outcome)));
    return;
  }
  CountJob(state_.metrics, outcome);
  FreeMesh();
  exported.reset();
  if (!outcome.ok()) {
    Fail(outcome.status());
    return;
  }
  if (!outcome->streamed) {
    working_.ShrinkTo(ResultBytes(outcome->result));
    Answer(std::make_shared<const JobOutcome>(*std::move(outcome)), false);
    return;
  }
  FinishWith(pieces_made().Summary(*outcome), *outcome);
}

void ResultCall::DoneExport(const std::shared_ptr<JobOutcome>& outcome) {
  mesh.reset();
  const absl::Status status = Export(*outcome);
  state_.metrics.JobEnded(status.code());
  if (status.ok()) {
    CountWork(state_.metrics, *outcome);
    state_.results.Keep(*this, outcome, export_plan_);
  }
  AnswerExport(status, *outcome, false);
}

void ResultCall::AnswerExport(const absl::Status& status, const JobOutcome& outcome, bool cached) {
  FreeMesh();
  ready.reset();
  if (!status.ok()) {
    Fail(status);
    return;
  }
  std::shared_ptr<ReplyStream> reply = ReplyOfExport(outcome, cached);
  if (!reply) {
    pieces_made().SetShared(cached, nullptr);
    FinishWith(pieces_made().Summary(outcome), outcome);
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
    record_.facts = Facts(outcome);
    result_ = std::move(reply);
    if (end_) FreeLocked();
  }
  Pump();
}

void ResultCall::Fail(const absl::Status& status) {
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
    if (end_) FreeLocked();  // the call ended while the job still ran
  }
  End(status);
}

void ResultCall::FinishWith(grpc::ByteBuffer summary, const JobOutcome& outcome) {
  {
    const std::lock_guard lock(mutex_);
    submitted_ = false;
    pending_.push_back(std::move(summary));
    record_.bytes_out = exported_bytes_ + pieces_made().sent_bytes();
    record_.raw_bytes_out = exported_bytes_ + pieces_made().bytes();
    record_.facts = Facts(outcome);
    last_is_pending_ = true;
    if (end_) FreeLocked();
  }
  Pump();
}

absl::Status ResultCall::Export(const JobOutcome& outcome) {
  // Writers may wait for memory as loading may, which TakeMemory has ended for the budget of the run.
  const std::shared_ptr<MemoryBudget> of_run = std::exchange(memory, MakeRequestMemory(state_.working, context));
  memory->set_leave(0);  // it ends soon
  MemoryCharge result(memory.get());
  working_.ShrinkTo(0);
  absl::Status status = context.Check();
  const bool held = !outcome.streamed && !ready;  // the cache pays for its own
  if (status.ok() && held) status = result.Grow(outcome.result.bytes(), "the result of a file:");
  if (status.ok()) {
    absl::StatusOr<uint64_t> bytes = absl::ResourceExhaustedError("out of memory for the file of the result");
    try {
      bytes = exported->Close(outcome);
    } catch (const std::bad_alloc&) {}
    status = bytes.status();
    exported_bytes_ = bytes.value_or(0);
  }
  exported.reset();  // its charges are of these budgets
  return status;
}

void ResultCall::Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached) {
  const PieceOptions options = PiecesOf(state_.options);
  std::shared_ptr<ReplyStream> result;
  std::optional<grpc::ByteBuffer> message;
  uint64_t sent_bytes = 0, raw_bytes = 0;
  if (IsOneMessage(ResultBytes(outcome->result))) {
    ResultPieces whole(config.request, config.settings, options);
    whole.SetShared(cached, outcome->sums);
    message = whole.Whole(plan_ ? &*plan_ : nullptr, outcome);
    sent_bytes = whole.sent_bytes();
    raw_bytes = whole.bytes();
  } else {
    auto stream =
        std::make_shared<ResultStream>(outcome, config.request, config.settings, options, ResponseCoder(), cached);
    if (plan_) stream->SetPlan(*plan_);  // it did not have the size, as lists are estimated
    result = std::move(stream);
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

ResultPieces& ResultCall::pieces_made() {
  if (!pieces_made_) pieces_made_.emplace(config.request, config.settings, PiecesOf(state_.options));
  return *pieces_made_;
}

absl::Status ResultCall::Begin(const ResultHeader& header) {
  if (gathers_) return gathered_.Begin(header);
  Post(pieces_made().Header(header));
  return absl::OkStatus();
}

absl::Status ResultCall::Write(size_t array, std::span<const uint8_t> bytes) {
  if (gathers_) return gathered_.Write(array, bytes);
  while (!bytes.empty()) {
    const std::span<const uint8_t> piece = bytes.first(std::min<uint64_t>(pieces_made().piece_bytes(), bytes.size()));
    if (absl::Status s = WaitForRoom(piece.size()); !s.ok()) return s;
    Post(pieces_made().Piece(array, piece, nullptr));
    pieces_made().Hash(piece);
    bytes = bytes.subspan(piece.size());
  }
  return absl::OkStatus();
}

bool ResultCall::IsOneMessage(uint64_t result_bytes) const {
  return !make_export_ && FitsOneMessage(result_bytes, config.settings);
}

absl::Status ResultCall::WaitForRoom(size_t bytes) {
  std::unique_lock lock(mutex_);
  // One piece may always be queued. Sweep ends the call of a client that reads nothing.
  while (!end_ && !pending_.empty() && pending_bytes_ + bytes > state_.options.stream_buffer_bytes) {
    if (absl::Status s = context.Check(); !s.ok()) return s;
    room_.wait_for(lock, kPollInterval);  // a passing deadline sends no notification
  }
  return end_ ? (end_->ok() ? absl::CancelledError("the call has ended") : *end_) : context.Check();
}

void ResultCall::GiveUp(std::string_view why) {
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

void ResultCall::HangUp() {
  const std::lock_guard lock(context_mutex_);
  if (!context_gone_) context_.TryCancel();
}

void ResultCall::OnProgress(std::string_view stage, double fraction) {
  if (!planned_) {  // the plan is sent first; of earlier progress, the last message of each stage follows it
    if (early_.empty() || early_.back().stage() != stage) early_.emplace_back().set_stage(std::string(stage));
    early_.back().set_fraction(fraction);
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  const bool stage_begins = fraction == 0 && !gathers_;  // a small result of little work is the only message
  if (!stage_begins && now - last_progress_ < kProgressInterval) return;
  last_progress_ = now;
  v1::Progress progress;
  progress.set_stage(std::string(stage));
  progress.set_fraction(fraction);
  PostProgress(progress);
}

void ResultCall::PostProgress(const v1::Progress& progress) {
  if (!sends_progress()) return;
  v1::VoxelizeResponse response;
  if (plan_) WriteTo(*std::exchange(plan_, std::nullopt), *response.mutable_plan());
  *response.mutable_progress() = progress;
  Post(ResponseCoder().Message(response));
}

void ResultCall::Post(grpc::ByteBuffer message) {
  {
    const std::lock_guard lock(mutex_);
    if (end_) return;
    pending_bytes_ += message.Length();
    pending_.push_back(std::move(message));
  }
  Pump();
}

void ResultCall::Pump() {
  std::unique_lock lock(mutex_);
  while (!making_ && !writing_ && !finished_) {
    if (end_) {
      finished_ = true;
      const grpc::Status status = ToGrpcStatus(*end_);
      lock.unlock();
      record_.Answered();
      FinishCall(status);
      return;
    }
    bool last = false;
    std::shared_ptr<ReplyStream> result;
    std::shared_ptr<ResultCall> keep;
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
      if (!end_ && !result->status().ok()) end_ = result->status();
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
      StartLastMessage(&writing_message_);
      return;
    }
    writing_ = true;
    const grpc::WriteOptions options = write_ahead_.Next(result && result->next_is_ready());
    lock.unlock();
    write_wait_->Begin();
    StartMessage(&writing_message_, options);
    if (!result) return;
    result->CatchUp();  // while the piece is being sent
    lock.lock();
    making_ = false;  // if the write is already done, this thread starts the next one
    if (end_) FreeLocked();
  }
}

void ResultCall::WriteDone(bool ok) {
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

void ResultCall::End(absl::Status status) {
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

void ResultCall::FreeLocked() {
  if (submitted_ || making_) return;  // freed when the worker, or the thread that makes a message, is done
  result_.reset();
  pieces.clear();
  uploads_.ShrinkTo(0);
  working_.ShrinkTo(0);
}

void ResultCall::Cancelled() {
  if (context.Check().ok()) context.Cancel();
  bool submitted;
  {
    const std::lock_guard lock(mutex_);
    submitted = submitted_;
  }
  if (submitted && state_.results.Withdraw(*this)) Done(context.Check());
}

void ResultCall::Ended() {
  std::shared_ptr<ResultCall> keep;
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
