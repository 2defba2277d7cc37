// What calls with one result have in common: their job, their messages and their end.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "job/memory_sink.h"
#include "jobs/voxelize_job.h"
#include "reply/result_pieces.h"
#include "reply/result_stream.h"
#include "reply/write_ahead.h"
#include "schedule/byte_budget.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// A derived class is the reactor of the call: it takes the request, and forwards gRPC's events to WriteDone, Cancelled
// and Ended. gRPC's threads never wait here; workers call the functions of VoxelizeJob and ResultSink. A result in
// memory is sent without the worker and without a copy; a result streamed slab by slab is sent by the worker, which
// waits for the client to read it; an exported one (ResultExports) is written by the worker, and its call has the plan,
// progress and the summary. The object lives until gRPC is done with the call and the worker with the job.
class ResultCall : protected VoxelizeJob, private ResultSink {
 protected:
  ResultCall(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc);

  // Call once, before anything that may end the call. `self` keeps the object alive until Ended.
  void KeepAlive(std::shared_ptr<ResultCall> self);

  // Steps of the request, in this order: MayBegin and the request, any number of pieces, SubmitJob. Errors are for End.
  // Takes the bytes of the mesh that are in the request, too.
  absl::Status TakeRequest(v1::VoxelizeRequest& message);
  // The next bytes of the mesh, with their CRC-32C, if the client sent one.
  absl::Status TakePiece(std::string piece, std::optional<uint32_t> crc32c);
  void SubmitJob();

  // Ends the call with `status` as soon as no write is in flight. Only the first call counts.
  void End(absl::Status status);
  // Ends the call of a client that does nothing.
  void GiveUp(std::string_view why);
  // A wait for the client that gives up after `limit_ms`. `what` lives as long as the program.
  std::unique_ptr<IdleWatch::Wait> WaitForClient(uint32_t limit_ms, const char* what);

  // gRPC's events.
  void WriteDone(bool ok);
  void Cancelled();
  void Ended();

  // The reactor's StartWrite, StartWriteAndFinish and Finish. A message lives until the write is done.
  virtual void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) = 0;
  virtual void StartLastMessage(const grpc::ByteBuffer* message) = 0;
  virtual void FinishCall(const grpc::Status& status) = 0;

  // The messages of an exported result, which then come in place of plan, progress and summary. Null: these.
  virtual std::shared_ptr<ReplyStream> ReplyOfExport(const JobOutcome& /*outcome*/, bool /*cached*/) { return nullptr; }
  // Before TakeRequest: the result goes to this export.
  void set_export(MakeExport make) { make_export_ = std::move(make); }
  // False: no message before the result.
  virtual bool sends_progress() const { return true; }

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and the worker are both done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<ResultCall> self_;      // until Ended
  CallRecord record_;
  std::mutex mutex_;
  bool configured_ = false;
  std::optional<absl::Status> end_;

 private:
  // On a worker's thread.
  absl::Status Planned(const Plan& plan, bool may_wait) override;
  // Sends the plan to the client, once.
  void PlanShared(const Plan& plan) override;
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& plan, bool cached) override;
  ResultSink* large_results() override { return exported ? &exported->sink() : this; }
  void Done(absl::StatusOr<JobOutcome> outcome) override;
  absl::Status Begin(const ResultHeader& header) override;
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override;
  absl::Status WaitForRoom(size_t bytes);
  bool IsOneMessage(uint64_t result_bytes) const;
  void OnProgress(std::string_view stage, double fraction);
  ResultPieces& pieces_made();
  // Hands the result to `exported`, which ends.
  absl::Status Export(const JobOutcome& outcome);
  void DoneExport(const std::shared_ptr<JobOutcome>& outcome);
  // The end of a call after Export.
  void AnswerExport(const absl::Status& status, const JobOutcome& outcome, bool cached);
  // The job ended with an error.
  void Fail(const absl::Status& status);
  // Ends the call with this last message.
  void FinishWith(grpc::ByteBuffer summary, const JobOutcome& outcome);

  // Sends a result in memory.
  void Answer(const std::shared_ptr<const JobOutcome>& outcome, bool cached);
  void PostPlan(const Plan& plan);
  void PostProgress(const v1::Progress& progress);
  // Queues a message.
  void Post(grpc::ByteBuffer message);
  // Cancels the call from outside of gRPC's threads.
  void HangUp();
  // Starts the next write or finishes the call, if neither is in flight.
  void Pump();
  // Frees everything that only a running job needs. With mutex_ held.
  void FreeLocked();

  MakeExport make_export_;  // null: the result goes to the caller
  BudgetShare uploads_, working_;
  bool planned_ = false;
  std::vector<v1::Progress> early_;  // before the plan: the last one of each stage
  std::chrono::steady_clock::time_point last_progress_;
  bool gathers_ = false;      // the result is to come in one message
  std::optional<Plan> plan_;  // not sent yet: it is sent with the first progress or the result

  // A streamed or exported result: accessed only by the worker.
  uint64_t exported_bytes_ = 0;
  Plan export_plan_;
  std::optional<ResultPieces> pieces_made_;
  MemorySink gathered_;  // slabs of a result that is sent in one message

  std::unique_ptr<IdleWatch::Wait> write_wait_;  // for the client to read a message

  std::mutex context_mutex_;  // while held, gRPC does not free context_
  bool context_gone_ = false;

  std::condition_variable room_;  // a write was done, or the call ended
  std::deque<grpc::ByteBuffer> pending_;
  size_t pending_bytes_ = 0;
  std::shared_ptr<ReplyStream> result_;
  bool last_is_pending_ = false;  // pending_ holds the last messages
  grpc::ByteBuffer writing_message_;
  WriteAhead write_ahead_;
  bool submitted_ = false;  // the job was submitted to the scheduler
  // A thread makes a message of result_; a write is in flight; the call was finished in gRPC.
  bool making_ = false, writing_ = false, finished_ = false;
};

}  // namespace voxelpipe
