#include "calls/whole_call.h"

#include <algorithm>
#include <string>
#include <utility>

#include <google/protobuf/arena.h>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "jobs/job_counts.h"
#include "jobs/job_memory.h"
#include "jobs/prepare_kept.h"
#include "reply/raw_message.h"
#include "reply/result_pieces.h"
#include "run/answer_burst.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
WholeCall* WholeCall::Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& request,
                             grpc::ByteBuffer& response) {
  const std::shared_ptr<WholeCall> call(new WholeCall(state, context, response));
  call->self_ = call;
  call->Start(request);
  return call.get();
}

WholeCall::WholeCall(ServiceState& state, grpc::CallbackServerContext& grpc_context, grpc::ByteBuffer& response)
    : state_(state),
      pass_(state.gate),
      context_(grpc_context),
      response_(response),
      record_(state, grpc_context, Rpc::kVoxelizeWhole),
      uploads_(state.uploads),
      working_(state.working) {
  SetDeadline(grpc_context, context);
}

void WholeCall::Start(grpc::ByteBuffer& request) {
  absl::Status status = MayBegin(pass_, record_);
  if (status.ok()) status = TakeRequest(request);
  if (!status.ok()) {
    End(std::move(status));
    return;
  }
  const std::shared_ptr<WholeCall> self = self_;  // job and call may end before Submit returns
  if (absl::Status s = state_.results.Submit({self, static_cast<VoxelizeJob*>(this)}); !s.ok()) {
    Done(std::move(s));
    return;
  }
  if (!context.Check().ok()) OnCancel();  // it may have come before the job could be withdrawn
}

absl::Status WholeCall::TakeRequest(grpc::ByteBuffer& message) {
  google::protobuf::Arena arena;
  auto& request = *google::protobuf::Arena::CreateMessage<v1::VoxelizeWholeRequest>(&arena);
  if (absl::Status s = ReadMessage(message, request); !s.ok()) return s;
  if (absl::Status s = ConfigureJob(state_, request.config(), record_.client, *this); !s.ok()) return s;
  std::string& bytes = *request.mutable_mesh();
  if (request.has_crc32c() &&
      Crc32c({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}) != request.crc32c()) {
    return absl::DataLossError("the CRC-32C of the mesh bytes from offset 0 does not fit");
  }
  if (bytes.empty()) return absl::OkStatus();
  if (kept) {
    if (absl::Status s = CheckMeshBytes(*kept, config, bytes.size(), false); !s.ok()) return s;
  }
  if (absl::Status s = TakeUploadBytes(state_, 0, bytes.size(), uploads_); !s.ok()) return s;
  if (absl::Status s = record_.TakeBytes(bytes.size()); !s.ok()) return s;
  pieces.push_back(std::move(bytes));
  return absl::OkStatus();
}

absl::Status WholeCall::Planned(const Plan& plan, bool may_wait) {
  if (plan.result_bytes > kWholeBytes) return NeedsStreamError(plan.result_bytes, kWholeBytes);
  uploads_.ShrinkTo(0);  // the file was freed after loading
  working_.ShrinkTo(0);  // of a failed worker
  if (absl::Status s = TakeMemory(plan, may_wait, context, working_); !s.ok()) return s;
  plan_ = plan;
  return absl::OkStatus();
}

void WholeCall::PlanShared(const Plan& plan) {
  if (plan.result_bytes > kWholeBytes && state_.results.Withdraw(*this)) {
    Done(NeedsStreamError(plan.result_bytes, kWholeBytes));
  }
}

void WholeCall::DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) {
  plan_ = plan;
  const uint64_t bytes = ResultBytes(outcome->result);
  // A plan that is too large is refused even if the result exists: the response does not depend on other requests.
  if (std::max(bytes, plan.result_bytes) > kWholeBytes) {
    Done(NeedsStreamError(std::max(bytes, plan.result_bytes), kWholeBytes));
    return;
  }
  state_.metrics.JobEnded(absl::StatusCode::kOk);
  Answer(outcome, cached);
}

void WholeCall::Done(absl::StatusOr<JobOutcome> outcome) {
  if (outcome.ok() && outcome->streamed) {
    VoxelizeResult gathered = slabs_.Take();
    gathered.stats = std::move(outcome->result.stats);
    outcome->result = std::move(gathered);
    outcome->streamed = false;
  }
  // Not known before: lists are estimated.
  if (outcome.ok() && ResultBytes(outcome->result) > kWholeBytes) {
    outcome = NeedsStreamError(ResultBytes(outcome->result), kWholeBytes);
  }
  CountJob(state_.metrics, outcome);
  mesh.reset();
  if (!outcome.ok()) {
    End(outcome.status());
    return;
  }
  working_.ShrinkTo(ResultBytes(outcome->result));
  Answer(std::make_shared<const JobOutcome>(*std::move(outcome)), false);
}

void WholeCall::Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached) {
  ResultPieces whole(config.settings, PiecesOf(state_.options), ResponseCoder::OfWholeCall());
  whole.SetShared(cached, outcome->sums);
  grpc::ByteBuffer message = whole.Whole(*plan_, outcome);
  response_.Swap(&message);  // it has no move
  record_.bytes_out = whole.sent_bytes();
  record_.raw_bytes_out = whole.bytes();
  record_.facts = Facts(*outcome);
  const uint32_t patience_ms = state_.options.stall_timeout_ms;
  write_wait_.emplace(state_.idle_watch, std::chrono::milliseconds(patience_ms),
                      [weak = std::weak_ptr<WholeCall>(self_)] {
                        if (const auto self = weak.lock()) self->GiveUp();
                      });
  write_wait_->Begin();
  End(absl::OkStatus());
}

void WholeCall::End(absl::Status status) {
  const std::shared_ptr<WholeCall> keep = self_;  // OnDone may come while Finish runs
  mesh.reset();
  kept.reset();
  pieces.clear();
  uploads_.ShrinkTo(0);
  if (!status.ok()) working_.ShrinkTo(0);
  const grpc::Status told = ToGrpcStatus(status);
  end_ = std::move(status);
  record_.Answered();
  if (!AnswerBurst::Later(this, [keep, told] { keep->Finish(told); })) Finish(told);
}

void WholeCall::GiveUp() {
  const std::lock_guard lock(context_mutex_);
  if (context_gone_) return;
  given_up_ = true;
  context_.TryCancel();  // the call can finish only after the write
}

void WholeCall::OnCancel() {
  if (context.Check().ok()) context.Cancel();
  // A running job ends soon by itself, and then the call.
  if (state_.results.Withdraw(*this)) Done(context.Check());
}

void WholeCall::OnDone() {
  write_wait_.reset();
  {
    const std::lock_guard lock(context_mutex_);
    context_gone_ = true;
  }
  if (given_up_) {
    end_ = absl::AbortedError(
        absl::StrCat("the client took nothing of the answer for ", state_.options.stall_timeout_ms, " ms"));
  }
  record_.Log(end_);
  working_.ShrinkTo(0);
  const std::shared_ptr<WholeCall> last = std::move(self_);
}

}  // namespace voxelpipe
