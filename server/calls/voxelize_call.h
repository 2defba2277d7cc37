// One Voxelize call: gathers the upload, hands the job to the pool, sends what comes of it.
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
// result that stands in memory is sent without the worker, from where it stands; one that leaves slab by slab is sent
// by the worker, which waits for the client to take it. The object lives until gRPC is done with the call and the
// worker is done with the job, whichever comes last.
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
  // Tells the client of the plan, once.
  void PlanShared(const Plan& plan) override;
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) override;
  ResultSink* large_results() override { return this; }
  void Done(absl::StatusOr<JobOutcome> outcome) override;
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;
  absl::Status WaitForRoom(size_t bytes);
  void OnProgress(std::string_view stage, double fraction);
  ResultPieces& pieces_made();

  // Answers with a result in memory.
  void Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached);
  // Queues a message.
  void Post(const v1::VoxelizeResponse& response);
  void Post(grpc::ByteBuffer message);
  // Makes the two waits below.
  void WatchForIdleness();
  // The client neither sends nor takes anything.
  void GiveUp(std::string_view why);
  // Cancels the call from outside of gRPC's threads.
  void HangUp();
  // Starts the next write or finishes the call, if neither is under way.
  void Pump();
  // Ends the call with `status` as soon as no write is in flight. Only the first one counts.
  void End(absl::Status status);
  // Frees what only a running job may still need. With mutex_ held.
  void FreeLocked();

  ServiceState& state_;
  const CallGate::Pass pass_;             // given back when gRPC and the worker are both done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<VoxelizeCall> self_;    // until OnDone
  CallRecord record_;

  // The upload: touched by one read at a time, with mutex_ held, then by the worker.
  grpc::ByteBuffer read_;
  bool configured_ = false;
  uint64_t upload_bytes_seen_ = 0;  // when the wait for more began
  bool whole_ = false;              // everything came in one message, and a small result goes back in one
  BudgetShare uploads_, working_;
  bool planned_ = false;
  std::vector<v1::Progress> early_;  // before the plan: the last one of each stage
  std::chrono::steady_clock::time_point last_progress_;
  std::optional<Plan> plan_;  // not sent yet: it goes with the whole result

  // A streamed result: touched by the worker only.
  std::optional<ResultPieces> pieces_made_;

  // For the upload, and for the client to take an answer.
  std::unique_ptr<IdleWatch::Wait> upload_wait_, write_wait_;

  std::mutex context_mutex_;  // while held, gRPC does not take context_ away
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
  bool submitted_ = false;  // a worker has the job or will have it
  // A thread makes a message of result_; a write is in flight; the call was finished in gRPC.
  bool making_ = false, writing_ = false, finished_ = false;
};

}  // namespace voxelpipe
