#include "inspect.h"

#include <memory>

#include <grpcpp/client_context.h>

#include "call_watch.h"
#include "channel.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/mesh_contents.h"
#include "wire/request.h"
#include "wire/response.h"

namespace voxelpipe {

absl::StatusOr<MeshInspection> InspectMesh(const std::string& target, const ConnectOptions& options,
                                           std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                           const JobContext& job) {
  const absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = OpenChannel(target, options);
  if (!channel.ok()) return channel.status();
  if (absl::Status s = job.Check(); !s.ok()) return s;
  const auto service = v1::VoxelizationService::NewStub(*channel);
  VoxelizeRequest smallest;
  smallest.grid.resolution = 1;
  smallest.fill = Fill::kParity;  // a fill makes the server count edges too
  v1::EstimateVoxelizationRequest request;
  *request.mutable_config() = MakeConfig(smallest, type);
  request.set_mesh_bytes(mesh_bytes.data(), mesh_bytes.size());
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  v1::EstimateVoxelizationResponse response;
  const grpc::Status status = service->EstimateVoxelization(&context, request, &response);
  if (!status.ok()) return CallStatus(status, job, target);
  MeshInspection seen{FromMessage(response.mesh()), FromMessage(response.contents()), {}, {}};
  seen.warnings = ReadWarnings(response);
  for (const v1::StageTime& time : response.contents().stages()) {
    seen.stages.emplace_back(time.stage(), time.milliseconds());
  }
  return seen;
}

}  // namespace voxelpipe
