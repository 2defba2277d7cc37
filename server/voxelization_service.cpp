#include "voxelization_service.h"

#include "base/machine.h"
#include "base/text.h"
#include "calls/call_record.h"
#include "calls/estimate_call.h"
#include "calls/many_call.h"
#include "calls/mesh_calls.h"
#include "calls/refused_call.h"
#include "calls/voxelize_call.h"
#include "calls/voxelize_mesh_call.h"
#include "reply/raw_message.h"
#include "shaders/catalog.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {

namespace {

constexpr size_t kMaxReasonBytes = 300;

void DescribeServer(const ServiceState& state, v1::GetServerInfoResponse& response) {
  response.set_version(VOXELPIPE_VERSION);
  const std::vector<DeviceReport> devices = state.pool.Devices();
  for (const DeviceReport& report : devices) {
    const std::string name(report.backend->name());
    // Devices of a kind follow one another.
    if (const auto& known = response.backends(); !known.empty() && known.rbegin()->name() == name) continue;
    v1::BackendInfo* info = response.add_backends();
    info->set_name(name);
    info->set_simd(std::string(report.backend->simd()));
  }
  v1::ServerLimits* limits = response.mutable_limits();
  limits->set_max_file_bytes(state.limits.load.max_file_bytes);
  limits->set_max_result_bytes(state.limits.plan.max_result_bytes);
  limits->set_max_working_bytes(state.limits.plan.max_working_bytes);
  limits->set_max_triangles(state.limits.load.max_triangles);
  limits->set_max_message_bytes(kMaxMessageBytes);
  limits->set_workers(uint32_t(state.loaders));
  limits->set_max_queue(state.options.max_queue);
  limits->set_max_mesh_store_bytes(state.meshes.max_bytes());
  response.set_threads(uint32_t(state.options.threads > 0 ? state.options.threads : CpuCount()));
  for (const DeviceReport& report : devices) {
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

template <typename Request, typename Response, typename Fill>
grpc::ServerUnaryReactor* VoxelizationServiceImpl::Answer(grpc::CallbackServerContext* context, Rpc rpc,
                                                          const grpc::ByteBuffer* request, grpc::ByteBuffer* response,
                                                          Fill fill) {
  CallRecord record(state_, *context, rpc);
  Request in;
  Response out;
  absl::Status status = record.admission();
  if (status.ok()) status = ReadMessage(OwnRequest(request), in);
  if (status.ok()) status = fill(record, in, out);
  if (status.ok()) WriteMessage(out, *response);
  record.Log(status);
  record.Answered();
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(ToGrpcStatus(status));
  return reactor;
}

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

grpc::ServerWriteReactor<grpc::ByteBuffer>* VoxelizationServiceImpl::VoxelizeMesh(grpc::CallbackServerContext* context,
                                                                                  const grpc::ByteBuffer* request) {
  using Reactor = grpc::ServerWriteReactor<grpc::ByteBuffer>;
  if (Reactor* refused = RefusedCall<Reactor>::CreateIfFull(state_, *context, Rpc::kVoxelizeMesh)) return refused;
  return VoxelizeMeshCall::Create(state_, *context, OwnRequest(request));
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::EstimateVoxelization(grpc::CallbackServerContext* context,
                                                                        const grpc::ByteBuffer* request,
                                                                        grpc::ByteBuffer* response) {
  return EstimateCall::Create(state_, *context, OwnRequest(request), *response);
}

grpc::ServerReadReactor<grpc::ByteBuffer>* VoxelizationServiceImpl::UploadMesh(grpc::CallbackServerContext* context,
                                                                               grpc::ByteBuffer* response) {
  return UploadMeshCall::Create(state_, *context, *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetMesh(grpc::CallbackServerContext* context,
                                                           const grpc::ByteBuffer* request,
                                                           grpc::ByteBuffer* response) {
  return Answer<v1::GetMeshRequest, v1::GetMeshResponse>(
      context, Rpc::kGetMesh, request, response,
      [&](const CallRecord&, const auto& in, auto& out) { return voxelpipe::GetMesh(state_, in, out); });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::DeleteMesh(grpc::CallbackServerContext* context,
                                                              const grpc::ByteBuffer* request,
                                                              grpc::ByteBuffer* response) {
  return Answer<v1::DeleteMeshRequest, v1::DeleteMeshResponse>(
      context, Rpc::kDeleteMesh, request, response, [&](const CallRecord& record, const auto& in, auto& out) {
        return voxelpipe::DeleteMesh(state_, record, in, out);
      });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::ListShaders(grpc::CallbackServerContext* context,
                                                               const grpc::ByteBuffer* request,
                                                               grpc::ByteBuffer* response) {
  return Answer<v1::ListShadersRequest, v1::ListShadersResponse>(
      context, Rpc::kListShaders, request, response, [](const CallRecord&, const auto&, auto& out) {
        for (const ShaderInfo& shader : voxelpipe::ListShaders()) *out.add_shaders() = ToMessage(shader);
        return absl::OkStatus();
      });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetServerInfo(grpc::CallbackServerContext* context,
                                                                 const grpc::ByteBuffer* request,
                                                                 grpc::ByteBuffer* response) {
  return Answer<v1::GetServerInfoRequest, v1::GetServerInfoResponse>(context, Rpc::kGetServerInfo, request, response,
                                                                     [&](const CallRecord&, const auto&, auto& out) {
                                                                       DescribeServer(state_, out);
                                                                       return absl::OkStatus();
                                                                     });
}

}  // namespace voxelpipe
