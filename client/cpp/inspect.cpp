#include "inspect.h"

#include <memory>

#include <grpcpp/client_context.h>

#include "call_watch.h"
#include "channel.h"
#include "voxelize_call.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/duration.h"
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
  WriteTo(smallest, *request.mutable_spec());
  WriteWithBytes(MeshSource::File(mesh_bytes, type), *request.mutable_mesh());
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  v1::EstimateVoxelizationResponse response;
  const grpc::Status status = service->EstimateVoxelization(&context, request, &response);
  if (!status.ok()) return CallStatus(status, job, target);
  MeshInspection seen{FromMessage(response.report()), FromMessage(response.contents()), {}, {}};
  seen.warnings = ReadWarnings(response);
  for (const v1::StageTime& time : response.contents().stages()) {
    seen.stages.emplace_back(time.stage(), MsOf(time.time()));
  }
  return seen;
}

}  // namespace voxelpipe
