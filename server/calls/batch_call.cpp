#include "calls/batch_call.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <google/protobuf/arena.h>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "jobs/job_counts.h"
#include "jobs/job_memory.h"
#include "jobs/prepare_kept.h"
#include "jobs/voxelize_job.h"
#include "reply/raw_message.h"
#include "run/answer_burst.h"
#include "wire/duration.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// In one message.
constexpr int kMaxJobs = 256;
constexpr size_t kMaxAnswers = 256, kMaxAnswerBytes = 256 << 10;

grpc::ByteBuffer ErrorMessage(uint64_t id, const absl::Status& status) {
  v1::VoxelizeBatchResponse response;
  v1::BatchReply& reply = *response.add_replies();
  reply.set_id(id);
  *reply.mutable_error() = ToRpcStatus(status);
  grpc::ByteBuffer message;
  WriteMessage(response, message);
  return message;
}

}  // namespace

class BatchCall::Job final : public VoxelizeJob {
 public:
  Job(std::shared_ptr<BatchCall> call, uint64_t id)
      : call_(std::move(call)), id_(id), uploads_(call_->state_.uploads), working_(call_->state_.working) {}

  uint64_t id() const { return id_; }
  BudgetShare& uploads() { return uploads_; }
  // With the call's lock held.
  uint64_t bytes_in_hand = 0;

  void Done(absl::StatusOr<JobOutcome> outcome) override {
    CountJob(call_->state_.metrics, outcome);
    if (!outcome.ok()) {
      working_.ShrinkTo(0);
      Answer answer;
      answer.message = std::make_unique<grpc::ByteBuffer>(ErrorMessage(id_, outcome.status()));
      Reply(std::move(answer), true);
      return;
    }
    working_.ShrinkTo(ResultBytes(outcome->result));
    Reply(std::make_shared<const JobOutcome>(*std::move(outcome)), false);
  }
  // The response contains the plan, so PlanShared is not overridden.
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) override {
    call_->state_.metrics.JobEnded(absl::StatusCode::kOk);
    plan_ = plan;
    Reply(outcome, cached);
  }

  std::weak_ptr<Task> self;

 private:
  absl::Status Planned(const Plan& plan, bool may_wait) override {
    uploads_.ShrinkTo(0);
    working_.ShrinkTo(0);  // of a failed worker
    if (absl::Status s = TakeMemory(plan, may_wait, context, working_); !s.ok()) return s;
    plan_ = plan;
    return absl::OkStatus();
  }
  ResultSink* large_results() override { return nullptr; }

  void Reply(const std::shared_ptr<const JobOutcome>& outcome, bool cached) {
    const PieceOptions options = PiecesOf(call_->state_.options);
    Answer answer;
    if (FitsOneMessage(ResultBytes(outcome->result), config.settings)) {
      ResultPieces whole(config.request, config.settings, options, ResponseCoder(id_));
      whole.SetShared(cached, outcome->sums);
      answer.message = std::make_unique<grpc::ByteBuffer>(whole.Whole(&plan_, outcome));
      answer.bytes = whole.sent_bytes();
      answer.raw_bytes = whole.bytes();
    } else {
      answer.stream =
          std::make_shared<ResultStream>(outcome, config.request, config.settings, options, ResponseCoder(id_), cached);
      answer.stream->SetPlan(plan_);
    }
    Reply(std::move(answer), false);
  }
  void Reply(Answer answer, bool failed) {
    FreeMesh();
    pieces.clear();
    uploads_.ShrinkTo(0);
    // The call owns this job until it has been answered, and this job the call until now.
    const std::shared_ptr<BatchCall> call = std::move(call_);
    answer.job = std::static_pointer_cast<Job>(self.lock());
    call->Ended(std::move(answer), failed);
    if (!AnswerBurst::Later(call.get(), [call] { call->Pump(); })) call->Pump();
  }

  std::shared_ptr<BatchCall> call_;
  const uint64_t id_;
  BudgetShare uploads_, working_;
  Plan plan_;
};

BatchCall* BatchCall::Create(ServiceState& state, grpc::CallbackServerContext& context) {
  std::shared_ptr<BatchCall> call(new BatchCall(state, context));
  call->self_ = call;
  const std::weak_ptr<BatchCall> weak = call;
  const uint32_t patience_ms = state.options.stall_timeout_ms;
  call->write_wait_ =
      std::make_unique<IdleWatch::Wait>(state.idle_watch, std::chrono::milliseconds(patience_ms), [weak, patience_ms] {
        if (const auto self = weak.lock()) {
          self->GiveUp(absl::StrCat("the client took nothing of the answers for ", patience_ms, " ms"));
        }
      });
  if (absl::Status status = MayBegin(call->pass_, call->record_.admission()); !status.ok()) {
    call->End(std::move(status));
  } else {
    call->closer_.emplace(state.gate, [weak] {
      if (const auto self = weak.lock()) self->StopTaking();
    });
  }
  call->Pump();
  return call.get();
}

BatchCall::BatchCall(ServiceState& state, grpc::CallbackServerContext& context)
    : state_(state), pass_(state.gate), context_(context), record_(state, context, Rpc::kVoxelizeBatch) {
  SetDeadline(context, deadline_);
}

BatchCall::~BatchCall() = default;

void BatchCall::OnReadDone(bool ok) {
  absl::Status status = absl::OkStatus();
  if (ok) {
    google::protobuf::Arena arena;
    auto& request = *google::protobuf::Arena::CreateMessage<v1::VoxelizeBatchRequest>(&arena);
    status = ReadMessage(read_, request);
    if (status.ok()) status = TakeAll(request);
  }
  {
    const std::lock_guard lock(mutex_);
    reading_ = false;
    if (!ok) half_closed_ = true;
  }
  if (!status.ok()) {
    End(std::move(status));
  } else {
    Pump();
  }
}

absl::Status BatchCall::TakeAll(v1::VoxelizeBatchRequest& message) {
  if (message.jobs_size() > kMaxJobs) {
    return absl::InvalidArgumentError(
        absl::StrCat("jobs: a message of ", message.jobs_size(), " jobs; at most ", kMaxJobs, " are allowed"));
  }
  for (const uint64_t id : message.cancel()) Withdraw(id);
  absl::Status status;
  for (int i = 0; status.ok() && i < message.jobs_size(); ++i) status = Take(*message.mutable_jobs(i));
  return status;
}

void BatchCall::Withdraw(uint64_t id) {
  std::shared_ptr<Job> job;
  {
    const std::lock_guard lock(mutex_);
    const auto found = ids_.find(id);
    if (found == ids_.end()) return;
    job = found->second;
  }
  job->context.Cancel();
  if (state_.results.Withdraw(*job)) job->Done(job->context.Check());
}

absl::Status BatchCall::Take(v1::BatchJob& message) {
  const auto job = std::make_shared<Job>(self_, message.id());
  job->self = job;
  bool draining;
  {
    const std::lock_guard lock(mutex_);
    if (end_) return absl::OkStatus();
    draining = draining_;
    if (!ids_.emplace(message.id(), job).second) {
      return absl::InvalidArgumentError(absl::StrCat("id: a job ", message.id(), " is already in use"));
    }
    jobs_.emplace(job.get(), job);
    ++jobs_taken_;
    job->bytes_in_hand = message.request().mesh().ByteSizeLong();
    bytes_ += job->bytes_in_hand;
  }
  absl::Status status = draining ? ShuttingDownError() : Prepare(message, *job);
  if (status.ok()) status = state_.results.Submit(job);
  if (!status.ok()) job->Done(std::move(status));
  // The cancellation may have come before the job could be withdrawn.
  if (!deadline_.Check().ok()) {
    job->context.Cancel();
    if (state_.results.Withdraw(*job)) job->Done(job->context.Check());
  }
  return absl::OkStatus();
}

absl::Status BatchCall::Prepare(v1::BatchJob& message, Job& job) {
  {
    const std::lock_guard lock(mutex_);
    // The start of the stream was already counted as the call of its first job.
    const bool counted = std::exchange(next_is_counted_, false);
    if (absl::Status s = counted ? absl::OkStatus() : record_.TakeCall(); !s.ok()) return s;
  }
  std::optional<JobContext::Clock::time_point> deadline = deadline_.deadline();
  if (message.has_timeout()) {
    const absl::StatusOr<std::chrono::milliseconds> timeout = ReadTimeout(message.timeout(), "timeout");
    if (!timeout.ok()) return timeout.status();
    const auto end = JobContext::Clock::now() + *timeout;
    if (!deadline || end < *deadline) deadline = end;
  }
  if (deadline) job.context.set_deadline(*deadline);
  if (absl::Status s = ConfigureJob(state_, message.request(), record_.client, job); !s.ok()) return s;
  if (absl::Status s = TakeListBytes(job.config, job.uploads()); !s.ok()) return s;
  const MeshData data = MeshDataOf(*message.mutable_request());
  if (data.bytes == nullptr) return absl::OkStatus();
  std::string& mesh = *data.bytes;
  if (absl::Status s = CheckMeshCrc(mesh, data.crc32c, 0); !s.ok()) return s;
  if (!job.kept.empty()) {
    if (absl::Status s = CheckMeshBytes(job.kept, job.config, mesh.size(), false); !s.ok()) return s;
  }
  if (absl::Status s = TakeUploadBytes(state_, 0, mesh.size(), job.uploads()); !s.ok()) return s;
  {
    const std::lock_guard lock(mutex_);
    if (absl::Status s = record_.TakeBytes(mesh.size()); !s.ok()) return s;
  }
  if (!mesh.empty()) job.pieces.push_back(std::move(mesh));
  return absl::OkStatus();
}

void BatchCall::Ended(Answer answer, bool failed) {
  {
    const std::lock_guard lock(mutex_);
    if (failed) ++jobs_failed_;
    const uint64_t held = answer.stream ? ResultBytes(answer.stream->outcome().result) : answer.message->Length();
    bytes_ += held;
    bytes_ -= std::exchange(answer.job->bytes_in_hand, held);
    if (end_) {
      bytes_ -= held;
      jobs_.erase(answer.job.get());
    } else {
      ready_.push_back(std::move(answer));
    }
  }
}

void BatchCall::StopTaking() {
  {
    const std::lock_guard lock(mutex_);
    draining_ = true;
  }
  Pump();
}

bool BatchCall::HasRoomLocked() const {
  return jobs_.size() < state_.options.batch_call_jobs && bytes_ < state_.options.batch_call_bytes;
}

void BatchCall::ChooseLocked() {
  size_t bytes = 0;
  do {
    if (ready_.front().message) bytes += ready_.front().message->Length();
    current_.push_back(std::move(ready_.front()));
    ready_.pop_front();
  } while (!current_.front().stream && !ready_.empty() && !ready_.front().stream && current_.size() < kMaxAnswers &&
           bytes + ready_.front().message->Length() <= kMaxAnswerBytes);
}

std::vector<BatchCall::Answer> BatchCall::WrittenLocked() {
  for (const Answer& answer : current_) {
    bytes_ -= answer.job->bytes_in_hand;
    jobs_.erase(answer.job.get());
  }
  return std::exchange(current_, {});
}

void BatchCall::Pump() {
  std::unique_lock lock(mutex_);
  std::shared_ptr<BatchCall> keep = self_;  // this thread may hold the last reference to the call
  while (!finished_) {
    if (!reading_ && !half_closed_ && !draining_ && !end_ && HasRoomLocked()) {
      reading_ = true;
      ++starting_reads_;
      lock.unlock();
      StartRead(&read_);
      lock.lock();
      --starting_reads_;
      continue;
    }
    // Nor may another thread end the call between the decision to read and the read: gRPC accepts no read after the
    // end.
    if (starting_reads_ > 0 || making_ || writing_) return;
    if (!end_ && current_.empty() && ready_.empty()) {
      if (!jobs_.empty() || !(half_closed_ || draining_)) return;  // jobs are in progress, or more may come
      end_ = half_closed_ ? absl::OkStatus() : ShuttingDownError();
    }
    if (end_) {
      finished_ = true;
      const grpc::Status status = ToGrpcStatus(*end_);
      lock.unlock();
      record_.Answered();
      Finish(status);
      return;
    }
    if (current_.empty()) ChooseLocked();
    const std::shared_ptr<ResultStream> stream = current_.front().stream;
    const std::shared_ptr<Job> job = current_.front().job;  // the stream reads its request
    if (stream) {
      making_ = true;  // without the lock, because hashing and compressing take long
      lock.unlock();
      const uint64_t sent_before = stream->sent_bytes(), raw_before = stream->bytes();
      grpc::ByteBuffer message = stream->Next();
      lock.lock();
      record_.bytes_out += stream->sent_bytes() - sent_before;
      record_.raw_bytes_out += stream->bytes() - raw_before;
      writing_message_.Swap(&message);
      last_of_current_ = stream->done();
      if (end_) {
        making_ = false;
        continue;
      }
    } else {
      std::vector<const grpc::ByteBuffer*> messages;
      for (const Answer& answer : current_) {
        messages.push_back(answer.message.get());
        record_.bytes_out += answer.bytes;
        record_.raw_bytes_out += answer.raw_bytes;
      }
      grpc::ByteBuffer message = RepliesInOne(messages);
      writing_message_.Swap(&message);
      last_of_current_ = true;
    }
    // The client may reuse the ids as soon as it receives this, possibly before gRPC reports the write as done.
    for (const Answer& answer : current_) {
      if (last_of_current_) ids_.erase(answer.job->id());
    }
    writing_ = true;
    // Messages that follow immediately are sent with it: the next piece or the next response. Not the last of several
    // pieces: their large result counts as in progress until the client has accepted all of it.
    const grpc::WriteOptions options = write_ahead_.Next(stream ? stream->next_is_ready() : !ready_.empty());
    lock.unlock();
    write_wait_->Begin();
    StartWrite(&writing_message_, options);
    if (stream) stream->CatchUp();  // while the piece is being sent
    lock.lock();
    if (stream) making_ = false;
  }
}

void BatchCall::OnWriteDone(bool ok) {
  write_wait_->End();
  std::vector<Answer> written;
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    writing_message_.Clear();
    if (last_of_current_) written = WrittenLocked();
  }
  if (!ok) {
    OnCancel();  // the client is gone
    return;
  }
  Pump();
}

void BatchCall::GiveUp(std::string_view why) {
  End(absl::AbortedError(std::string(why)));
  HangUp();  // the call can finish only after the write in flight
}

void BatchCall::HangUp() {
  const std::lock_guard lock(context_mutex_);
  if (!context_gone_) context_.TryCancel();
}

void BatchCall::End(absl::Status status) {
  std::vector<std::shared_ptr<Job>> jobs;
  std::deque<Answer> ready;  // freed without the lock
  {
    const std::lock_guard lock(mutex_);
    if (!end_) end_ = std::move(status);
    ready.swap(ready_);
    for (const Answer& answer : ready) jobs_.erase(answer.job.get());
    for (const auto& [key, job] : jobs_) jobs.push_back(job);
  }
  if (deadline_.Check().ok()) deadline_.Cancel();
  for (const std::shared_ptr<Job>& job : jobs) {
    job->context.Cancel();
    if (state_.results.Withdraw(*job)) job->Done(job->context.Check());
  }
  Pump();
}

void BatchCall::OnCancel() {
  if (deadline_.Check().ok()) deadline_.Cancel();
  End(deadline_.Check());
}

void BatchCall::OnDone() {
  std::shared_ptr<BatchCall> keep;
  write_wait_->End();
  closer_.reset();
  {
    const std::lock_guard lock(context_mutex_);
    context_gone_ = true;
  }
  {
    const std::lock_guard lock(mutex_);
    record_.facts = {{"jobs", jobs_taken_}, {"jobs_failed", jobs_failed_}};
    record_.Log(end_.value_or(absl::UnknownError("the call ended by itself")));
    keep = std::move(self_);
  }
}

}  // namespace voxelpipe
