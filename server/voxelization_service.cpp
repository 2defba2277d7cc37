#include "voxelization_service.h"

#include "calls/call_record.h"
#include "calls/estimate_call.h"
#include "calls/many_call.h"
#include "calls/mesh_calls.h"
#include "calls/refused_call.h"
#include "calls/voxelize_call.h"
#include "calls/whole_call.h"
#include "pipeline/backend.h"
#include "shaders/catalog.h"
#include "wire/response.h"
#include "wire/status.h"
#include "wire/text.h"

namespace voxelpipe {

namespace {

constexpr size_t kMaxReasonBytes = 300;

void DescribeServer(const ServiceState& state, v1::GetServerInfoResponse& response) {
  response.set_version(VOXELPIPE_VERSION);
  for (const std::string& name : AvailableBackends()) {
    const auto backend = SelectBackend(name == "cuda" ? BackendChoice::kCuda : BackendChoice::kCpu);
    if (!backend.ok()) continue;
    v1::BackendInfo* info = response.add_backends();
    info->set_name(name);
    info->set_simd(std::string((*backend)->simd()));
  }
  v1::ServerLimits* limits = response.mutable_limits();
  limits->set_max_file_bytes(state.limits.load.max_file_bytes);
  limits->set_max_result_bytes(state.limits.plan.max_result_bytes);
  limits->set_max_working_bytes(state.limits.plan.max_working_bytes);
  limits->set_max_triangles(state.limits.load.max_triangles);
  limits->set_max_message_bytes(kMaxMessageBytes);
  limits->set_workers(uint32_t(state.options.workers));
  limits->set_max_queue(state.options.max_queue);
  limits->set_max_mesh_store_bytes(state.meshes.max_bytes());
  response.set_threads(uint32_t(state.options.threads));
  for (const DeviceReport& report : state.pool.Devices()) {
    v1::Device* device = response.add_devices();
    device->set_name(std::string(report.backend->device()));
    device->set_backend(std::string(report.backend->name()));
    device->set_model(report.backend->model());
    device->set_memory_bytes(report.backend->memory_bytes());
    device->set_workers(uint32_t(report.workers));
    device->set_state(report.serving ? v1::DEVICE_STATE_SERVING : v1::DEVICE_STATE_QUARANTINED);
    device->set_reason(CleanText(report.reason, kMaxReasonBytes));
  }
}

}  // namespace

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizationServiceImpl::Voxelize(
    grpc::CallbackServerContext* context) {
  using Reactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;
  if (Reactor* refused = RefusedCall<Reactor>::CreateIfFull(state_, *context, Rpc::kVoxelize)) return refused;
  return VoxelizeCall::Create(state_, *context);
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizationServiceImpl::VoxelizeMany(
    grpc::CallbackServerContext* context) {
  return ManyCall::Create(state_, *context);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::VoxelizeWhole(grpc::CallbackServerContext* context,
                                                                 const grpc::ByteBuffer* request,
                                                                 grpc::ByteBuffer* response) {
  // gRPC made it for this call and does not look at it again: reading it frees its bytes.
  using FullCall = RefusedCall<grpc::ServerUnaryReactor>;
  if (grpc::ServerUnaryReactor* refused = FullCall::CreateIfFull(state_, *context, Rpc::kVoxelizeWhole)) return refused;
  return WholeCall::Create(state_, *context, *const_cast<grpc::ByteBuffer*>(request), *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::EstimateVoxelization(grpc::CallbackServerContext* context,
                                                                        const v1::EstimateVoxelizationRequest* request,
                                                                        v1::EstimateVoxelizationResponse* response) {
  return EstimateCall::Create(state_, *context, *request, *response);
}

grpc::ServerReadReactor<v1::UploadMeshRequest>* VoxelizationServiceImpl::UploadMesh(
    grpc::CallbackServerContext* context, v1::UploadMeshResponse* response) {
  return UploadMeshCall::Create(state_, *context, *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetMesh(grpc::CallbackServerContext* context,
                                                           const v1::GetMeshRequest* request,
                                                           v1::GetMeshResponse* response) {
  return Answer(context, Rpc::kGetMesh,
                [&](const CallRecord&) { return voxelpipe::GetMesh(state_, *request, *response); });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::DeleteMesh(grpc::CallbackServerContext* context,
                                                              const v1::DeleteMeshRequest* request,
                                                              v1::DeleteMeshResponse* response) {
  return Answer(context, Rpc::kDeleteMesh,
                [&](const CallRecord& record) { return voxelpipe::DeleteMesh(state_, record, *request, *response); });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::ListShaders(grpc::CallbackServerContext* context,
                                                               const v1::ListShadersRequest* /*request*/,
                                                               v1::ListShadersResponse* response) {
  return Answer(context, Rpc::kListShaders, [&](const CallRecord&) {
    for (const ShaderInfo& shader : voxelpipe::ListShaders()) *response->add_shaders() = ToMessage(shader);
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetServerInfo(grpc::CallbackServerContext* context,
                                                                 const v1::GetServerInfoRequest* /*request*/,
                                                                 v1::GetServerInfoResponse* response) {
  return Answer(context, Rpc::kGetServerInfo, [&](const CallRecord&) {
    DescribeServer(state_, *response);
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::Answer(grpc::CallbackServerContext* context, Rpc rpc,
                                                          const std::function<absl::Status(const CallRecord&)>& fill) {
  CallRecord record(state_, *context, rpc);
  absl::Status status = record.admission();
  if (status.ok()) status = fill(record);
  record.Log(status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(ToGrpcStatus(status));
  return reactor;
}

}  // namespace voxelpipe
