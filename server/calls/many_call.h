// One VoxelizeMany call: many small jobs on one stream, answered as they are done.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "calls/call_record.h"
#include "calls/react_at_once.h"
#include "reply/result_stream.h"
#include "reply/write_ahead.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// gRPC's threads call the On... functions and never wait here; workers end the jobs. No more is read while as many jobs
// or bytes are in hand as the options allow, so that a client that does not take its answers cannot fill the server.
// The object lives until gRPC is done with the call and all of its jobs have ended.
class ManyCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  // The reactor of a new call. `state` must outlive it.
  static ManyCall* Create(ServiceState& state, grpc::CallbackServerContext& context);
  ~ManyCall() override;

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  class Job;
  // The answer of a job: one message, or those of a stream.
  struct Answer {
    std::shared_ptr<Job> job;
    std::unique_ptr<grpc::ByteBuffer> message;  // a ByteBuffer itself is copied where it is moved
    std::shared_ptr<ResultStream> stream;
    uint64_t bytes = 0, raw_bytes = 0;  // of the result in `message`: as they are sent, and before compression
  };

  ManyCall(ServiceState& state, grpc::CallbackServerContext& context);

  // An error ends the call.
  absl::Status TakeAll(v1::VoxelizeManyRequest& message);
  absl::Status Take(v1::VoxelizeManyRequest& request);
  // An error ends the job.
  absl::Status Prepare(v1::VoxelizeManyRequest& request, Job& job);
  // The job has ended, on any thread. Pump is left to the caller.
  void Ended(Answer answer, bool failed);
  // The server shuts down: jobs in progress are answered, no further ones are read.
  void StopTaking();
  void GiveUp(std::string_view why);
  void HangUp();
  // Starts the next write, read or the end of the call, as far as they are due and not under way.
  void Pump();
  void End(absl::Status status);
  // Chooses what is written next of what is ready.
  void ChooseLocked();
  // What is in writing has been sent. Out: it, to be freed without the lock.
  std::vector<Answer> WrittenLocked();
  bool HasRoomLocked() const;

  ServiceState& state_;
  const CallGate::Pass pass_;             // given back when gRPC and all jobs are done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<ManyCall> self_;        // until OnDone
  CallRecord record_;
  JobContext deadline_;  // of the call, which all jobs share
  std::unique_ptr<IdleWatch::Wait> write_wait_;
  std::optional<CallGate::Closer> closer_;

  std::mutex context_mutex_;  // while held, gRPC does not take context_ away
  bool context_gone_ = false;

  grpc::ByteBuffer read_;  // in flight while reading_

  std::mutex mutex_;
  std::unordered_map<const Job*, std::shared_ptr<Job>> jobs_;  // in hand: read, and not yet answered as a whole
  std::unordered_set<uint64_t> ids_;                           // of those whose answer did not go out yet
  uint64_t bytes_ = 0;                                         // that they hold: meshes and results
  bool next_is_counted_ = true;                                // the next job was counted as a call
  uint64_t jobs_taken_ = 0, jobs_failed_ = 0;
  std::deque<Answer> ready_;
  std::vector<Answer> current_;  // being written: one that is a stream, or those of one message
  grpc::ByteBuffer writing_message_;
  bool last_of_current_ = false;  // the message in flight is
  WriteAhead write_ahead_;
  int starting_reads_ = 0;  // threads that are about to start one
  bool reading_ = false, making_ = false, writing_ = false, finished_ = false;
  bool half_closed_ = false, draining_ = false;
  bool takes_more_ = false;  // the client understands answers that hold more
  std::optional<absl::Status> end_;
};

}  // namespace voxelpipe
