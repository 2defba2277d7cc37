#include "calls/head_check.h"

#include <memory>
#include <utility>

#include "calls/call_setup.h"
#include "calls/refused_call.h"
#include "state/full_queue.h"

namespace voxelpipe {
namespace {

// True if the service counts the call at its gate (CallGate). Short questions are answered as long as it listens.
bool PassesGate(Rpc rpc) {
  switch (rpc) {
    case Rpc::kListShaders:
    case Rpc::kGetServerInfo:
    case Rpc::kGetMesh:
    case Rpc::kListMeshes:
    case Rpc::kReleaseMesh:
    case Rpc::kDeleteMesh: return false;
    default: return true;
  }
}

}  // namespace

std::optional<RefusedHead> CheckHead(ServiceState& state, const CallHead& head, Rpc rpc) {
  std::string name;
  absl::Status status = state.access->Check(head.authorization, rpc, head.certificate, QuotaClock::now(), &name);
  if (PassesGate(rpc)) {
    const CallGate::Pass pass(state.gate);  // given back at once: the call takes its own
    status = MayBegin(pass, status);
  }
  const bool may_begin = status.ok();
  if (may_begin && (rpc == Rpc::kVoxelize || rpc == Rpc::kExportFile)) {
    if (const std::shared_ptr<const FullQueue::Answer> full = state.full_queue.Refusal()) status = full->status;
  }
  if (status.ok()) return std::nullopt;
  CallRecord record(state, head, rpc, status, std::move(name));
  if (may_begin) {
    EndOfFullQueue(state, record, status);
  } else {
    record.Log(status);
  }
  return RefusedHead{std::move(status), record.request_id};
}

}  // namespace voxelpipe
