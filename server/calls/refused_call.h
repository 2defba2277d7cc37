// A call that arrives while the queue is full: refused before it is read.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "calls/call_setup.h"
#include "calls/react_at_once.h"
#include "state/full_queue.h"
#include "state/service_state.h"
#include "wire/status.h"

namespace voxelpipe {

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
    if (!log_) {
      record_.Count(status_);
    } else {
      if (*log_ > 0) record_.facts.push_back({"refused_before", *log_});
      record_.Log(status_);
    }
    delete this;
  }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  RefusedCall(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc, const FullQueue::Answer& answer)
      : pass_(state.gate), record_(state, context, rpc), status_(MayBegin(pass_, record_)) {
    const bool strange = !status_.ok();  // callers without rights get that error instead
    if (!strange) status_ = answer.status;
    log_ = strange ? 0 : state.full_queue.MayLog();
    record_.Answered();
    this->Finish(strange ? ToGrpcStatus(status_) : answer.grpc_status);
  }

  const CallGate::Pass pass_;  // a drain waits until the response was sent
  CallRecord record_;
  absl::Status status_;
  std::optional<uint64_t> log_;
};

}  // namespace voxelpipe
