// One VoxelizeWhole call: one message in, one small result out.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "calls/react_at_once.h"
#include "job/memory_sink.h"
#include "jobs/voxelize_job.h"
#include "schedule/byte_budget.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// gRPC's threads begin the call and never wait here; the thread that ends the job, usually a worker, finishes the call
// without another hand-over. Finish ends every call exactly once, when its job has ended. The object lives until gRPC
// and the worker are both done with it.
class WholeCall final : public grpc::ServerUnaryReactor, private VoxelizeJob {
 public:
  // The reactor of a new call. `state` must outlive it; `request` is consumed immediately, `response` must live until
  // the call ends.
  static WholeCall* Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& request,
                           grpc::ByteBuffer& response);

  void OnCancel() override;
  void OnDone() override;
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  WholeCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  void Start(grpc::ByteBuffer& request);
  absl::Status TakeRequest(grpc::ByteBuffer& request);

  // On a worker's thread.
  absl::Status Planned(const Plan& plan, bool may_wait) override;
  void PlanShared(const Plan& plan) override;
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) override;
  void Done(absl::StatusOr<JobOutcome> outcome) override;
  // A small result comes in slabs only if the options make slabs that small. Not null, so that plans and their errors
  // are those of Voxelize.
  ResultSink* large_results() override { return &slabs_; }

  // Ends the call with a result in memory, or because it is too large.
  void Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached);
  void End(absl::Status status);
  // Called when the client does not read the response.
  void GiveUp();

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and the worker are both done
  grpc::CallbackServerContext& context_;  // see context_mutex_
  grpc::ByteBuffer& response_;
  std::shared_ptr<WholeCall> self_;  // until OnDone
  CallRecord record_;
  BudgetShare uploads_, working_;
  std::optional<Plan> plan_;
  MemorySink slabs_;
  absl::Status end_;  // set before Finish, read in OnDone
  std::optional<IdleWatch::Wait> write_wait_;

  std::mutex context_mutex_;  // while held, gRPC does not free context_
  bool context_gone_ = false, given_up_ = false;
};

}  // namespace voxelpipe
