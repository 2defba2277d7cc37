// A call that arrives while the queue is full: refused before it is read.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "calls/call_setup.h"
#include "state/full_queue.h"
#include "state/service_state.h"
#include "wire/status.h"

namespace voxelpipe {

// Ends the record of a call that was refused because the queue is full. All are counted, one a second has a log line.
inline void EndOfFullQueue(ServiceState& state, CallRecord& record, const absl::Status& status) {
  const std::optional<uint64_t> unlogged = state.full_queue.MayLog();
  if (!unlogged) {
    record.Count(status);
    return;
  }
  if (*unlogged > 0) record.facts.push_back({"refused_before", *unlogged});
  record.Log(status);
}

// Reactor: what the service's method returns. Deletes itself when gRPC is done with it.
template <typename Reactor>
class RefusedCall final : public Reactor {
 public:
  // The reactor that refuses the call, or null if the queue has room and the call must be handled. `state` must outlive
  // it.
  static Reactor* CreateIfFull(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc) {
    std::shared_ptr<const FullQueue::Answer> answer = state.full_queue.Refusal();
    return answer ? new RefusedCall(state, context, rpc, *answer) : nullptr;
  }

  void OnDone() override {
    if (may_begin_) {
      EndOfFullQueue(state_, record_, status_);
    } else {
      record_.Log(status_);
    }
    delete this;
  }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  RefusedCall(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc, const FullQueue::Answer& answer)
      : state_(state),
        pass_(state.gate),
        record_(state, context, rpc),
        status_(MayBegin(pass_, record_.admission())),
        may_begin_(status_.ok()) {
    if (may_begin_) status_ = answer.status;
    record_.Answered();
    this->Finish(may_begin_ ? answer.grpc_status : ToGrpcStatus(status_));
  }

  ServiceState& state_;
  const CallGate::Pass pass_;  // a drain waits until the response was sent
  CallRecord record_;
  absl::Status status_;
  const bool may_begin_;  // otherwise status_ is the caller's own error
};

}  // namespace voxelpipe
