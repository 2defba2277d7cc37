// One Voxelize call: receives the upload, submits the job to the pool, sends the result.
#pragma once

#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "calls/call_record.h"
#include "calls/react_at_once.h"
#include "jobs/voxelize_job.h"
#include "reply/result_pieces.h"
#include "reply/result_stream.h"
#include "reply/write_ahead.h"
#include "schedule/byte_budget.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// gRPC's threads call the On... functions and never wait here; workers call those of VoxelizeJob and ResultSink. A
// result in memory is sent without the worker and without a copy; a result streamed slab by slab is sent by the worker,
// which waits for the client to read it. The object lives until gRPC is done with the call and the worker with the job.
class VoxelizeCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                           private VoxelizeJob,
                           private ResultSink {
 public:
  // The reactor of a new call. `state` must outlive it.
  static VoxelizeCall* Create(ServiceState& state, grpc::CallbackServerContext& context);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& context);

  // With mutex_ held.
  absl::Status TakeMessage(v1::VoxelizeRequest& request);
  absl::Status TakeConfig(const v1::VoxelizeConfig& config);
  absl::Status TakePiece(std::string piece);
  void UploadEnded();
  void SubmitJob();

  // On a worker's thread.
  absl::Status Planned(const Plan& plan, bool may_wait) override;
  // Sends the plan to the client, once.
  void PlanShared(const Plan& plan) override;
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) override;
  ResultSink* large_results() override { return this; }
  void Done(absl::StatusOr<JobOutcome> outcome) override;
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;
  absl::Status WaitForRoom(size_t bytes);
  void OnProgress(std::string_view stage, double fraction);
  ResultPieces& pieces_made();

  // Sends a result in memory.
  void Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached);
  // Queues a message.
  void Post(const v1::VoxelizeResponse& response);
  void Post(grpc::ByteBuffer message);
  // Creates the two waits below.
  void WatchForIdleness();
  // Called when the client neither sends nor reads.
  void GiveUp(std::string_view why);
  // Cancels the call from outside of gRPC's threads.
  void HangUp();
  // Starts the next write or finishes the call, if neither is in flight.
  void Pump();
  // Ends the call with `status` as soon as no write is in flight. Only the first call counts.
  void End(absl::Status status);
  // Frees everything that only a running job needs. With mutex_ held.
  void FreeLocked();

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and the worker are both done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<VoxelizeCall> self_;    // until OnDone
  CallRecord record_;

  // The upload: accessed by one read at a time, with mutex_ held, then by the worker.
  grpc::ByteBuffer read_;
  bool configured_ = false;
  uint64_t upload_bytes_seen_ = 0;  // at the start of the wait for more
  bool whole_ = false;              // the request came in one message, and a small result is sent in one
  BudgetShare uploads_, working_;
  bool planned_ = false;
  std::vector<v1::Progress> early_;  // before the plan: the last one of each stage
  std::chrono::steady_clock::time_point last_progress_;
  std::optional<Plan> plan_;  // not sent yet: it is sent with the whole result

  // A streamed result: accessed only by the worker.
  std::optional<ResultPieces> pieces_made_;

  // Waits for the upload, and for the client to read a response.
  std::unique_ptr<IdleWatch::Wait> upload_wait_, write_wait_;

  std::mutex context_mutex_;  // while held, gRPC does not free context_
  bool context_gone_ = false;

  std::mutex mutex_;
  std::condition_variable room_;  // a write was done, or the call ended
  std::deque<grpc::ByteBuffer> pending_;
  size_t pending_bytes_ = 0;
  std::shared_ptr<ResultStream> result_;
  bool last_is_pending_ = false;  // pending_ holds the last messages
  grpc::ByteBuffer writing_message_;
  WriteAhead write_ahead_;
  std::optional<absl::Status> end_;
  bool submitted_ = false;  // the job was submitted to the scheduler
  // A thread makes a message of result_; a write is in flight; the call was finished in gRPC.
  bool making_ = false, writing_ = false, finished_ = false;
};

}  // namespace voxelpipe
