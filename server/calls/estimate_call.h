// One EstimateVoxelization call. With a mesh it is a job of the pool, without one it is answered immediately.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "base/job_context.h"
#include "calls/call_record.h"
#include "schedule/byte_budget.h"
#include "schedule/task.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/request.h"

namespace voxelpipe {

class EstimateCall final : public grpc::ServerUnaryReactor {
 public:
  // Reads `request`. `state` must outlive the reactor, `response` must live until the call ends.
  static EstimateCall* Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& request,
                              grpc::ByteBuffer& response);

  void OnCancel() override;
  void OnDone() override;
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  EstimateCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  // The task of an estimate with a mesh: loaded and planned on a loader.
  class MeshTask;

  void Start(grpc::ByteBuffer& request);
  absl::StatusOr<ParsedConfig> ParseMessage() const;
  absl::Status FindKeptMeshes(const ParsedConfig& config);
  // The bytes of the mesh, if it comes with the request.
  const std::string& data() const { return request_.mesh().bytes().data(); }
  // Of the request's mesh, before it is loaded.
  JobCost Cost(const ParsedConfig& config) const;
  absl::Status FromSummary(const ParsedConfig& config);
  absl::Status FromMesh(const ParsedConfig& config);
  void End(const absl::Status& status);

  ServiceState& state_;
  const CallGate::Pass pass_;  // released when gRPC and the worker are both done
  v1::EstimateVoxelizationRequest request_;
  grpc::ByteBuffer& response_bytes_;  // until the call is answered
  v1::EstimateVoxelizationResponse response_;
  std::shared_ptr<EstimateCall> self_;           // until OnDone
  std::vector<std::shared_ptr<KeptMesh>> kept_;  // the meshes that the request names
  CallRecord record_;
  BudgetShare uploads_;
  JobContext job_;
  TaskTraits kinds_;  // of device that may run the request
  std::shared_ptr<MemoryBudget> memory_;
  std::mutex mutex_;
  std::shared_ptr<MeshTask> task_;
  absl::Status status_;
};

}  // namespace voxelpipe
