// One VoxelizeBatch call: many small jobs on one stream, answered in order of completion.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "calls/call_record.h"
#include "reply/result_stream.h"
#include "reply/write_ahead.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// gRPC's threads call the On... functions and never wait here; workers end the jobs. Reading pauses while jobs or bytes
// in progress reach the limits of the options, so that a client that does not read its responses cannot fill the
// server. The object lives until gRPC is done with the call and all of its jobs have ended.
class BatchCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  // The reactor of a new call. `state` must outlive it.
  static BatchCall* Create(ServiceState& state, grpc::CallbackServerContext& context);
  ~BatchCall() override;

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  class Job;
  // The response of a job: one message, or those of a stream.
  struct Answer {
    std::shared_ptr<Job> job;
    std::unique_ptr<grpc::ByteBuffer> message;  // a ByteBuffer is copied when it is moved
    std::shared_ptr<ResultStream> stream;
    uint64_t bytes = 0, raw_bytes = 0;  // of the result in `message`: as sent, and before compression
  };

  BatchCall(ServiceState& state, grpc::CallbackServerContext& context);

  // An error ends the call.
  absl::Status TakeAll(v1::VoxelizeBatchRequest& message);
  absl::Status Take(v1::BatchJob& message);
  // Ends a job that is not wanted any more; no effect on one that has ended.
  void Withdraw(uint64_t id);
  // An error ends the job.
  absl::Status Prepare(v1::BatchJob& message, Job& job);
  // The job has ended, on any thread. The caller calls Pump.
  void Ended(Answer answer, bool failed);
  // The server shuts down: jobs in progress are answered, no further ones are read.
  void StopTaking();
  void GiveUp(std::string_view why);
  void HangUp();
  // Starts the next write, read or the end of the call, if they are due and not in flight.
  void Pump();
  void End(absl::Status status);
  // Chooses the next message among the ready ones.
  void ChooseLocked();
  // The current write is done. Out: its message, to be freed without the lock.
  std::vector<Answer> WrittenLocked();
  bool HasRoomLocked() const;

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and all jobs are done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<BatchCall> self_;       // until OnDone
  CallRecord record_;
  JobContext deadline_;  // of the call, which all jobs share
  std::unique_ptr<IdleWatch::Wait> write_wait_;
  std::optional<CallGate::Closer> closer_;

  std::mutex context_mutex_;  // while held, gRPC does not free context_
  bool context_gone_ = false;

  grpc::ByteBuffer read_;  // in flight while reading_

  std::mutex mutex_;
  std::unordered_map<const Job*, std::shared_ptr<Job>> jobs_;  // in progress: read, and not completely answered
  std::unordered_map<uint64_t, std::shared_ptr<Job>> ids_;     // of those whose last reply was not sent yet
  uint64_t bytes_ = 0;                                         // of their meshes and results
  bool next_is_counted_ = true;                                // the next job was counted as a call
  uint64_t jobs_taken_ = 0, jobs_failed_ = 0;
  std::deque<Answer> ready_;
  std::vector<Answer> current_;  // being written: one stream, or the responses of one message
  grpc::ByteBuffer writing_message_;
  bool last_of_current_ = false;  // the message in flight is
  WriteAhead write_ahead_;
  int starting_reads_ = 0;  // threads that are about to start one
  bool reading_ = false, making_ = false, writing_ = false, finished_ = false;
  bool half_closed_ = false, draining_ = false;
  std::optional<absl::Status> end_;
};

}  // namespace voxelpipe
