#include "voxelization_service.h"

#include "base/machine.h"
#include "base/text.h"
#include "calls/batch_call.h"
#include "calls/call_record.h"
#include "calls/estimate_call.h"
#include "calls/export_file_call.h"
#include "calls/mesh_calls.h"
#include "calls/refused_call.h"
#include "calls/voxelize_call.h"
#include "calls/voxelize_upload_call.h"
#include "encode/format_registry.h"
#include "reply/raw_message.h"
#include "shaders/catalog.h"
#include "wire/contract_revision.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {

namespace {

constexpr size_t kMaxReasonBytes = 300;

void DescribeServer(const ServiceState& state, v1::GetServerInfoResponse& response) {
  response.set_version(VOXELPIPE_VERSION);
  response.set_contract_revision(kContractRevision);
  const std::vector<DeviceReport> devices = state.pool.Devices();
  for (const DeviceReport& report : devices) {
    // Devices of a kind follow one another.
    const v1::Backend backend = BackendNamed(report.backend->name());
    if (const auto& known = response.backends(); !known.empty() && known.rbegin()->backend() == backend) continue;
    v1::BackendInfo* info = response.add_backends();
    info->set_backend(backend);
    info->set_simd(SimdNamed(report.backend->simd()));
  }
  v1::ServerLimits* limits = response.mutable_limits();
  limits->set_max_file_bytes(int64_t(state.limits.load.max_file_bytes));
  limits->set_max_result_bytes(int64_t(state.limits.plan.max_result_bytes));
  limits->set_max_working_bytes(int64_t(state.limits.plan.max_working_bytes));
  limits->set_max_triangles(int64_t(state.limits.load.max_triangles));
  limits->set_max_message_bytes(kMaxMessageBytes);
  limits->set_load_workers(int32_t(state.loaders));
  limits->set_max_queue(int32_t(state.options.max_queue));
  limits->set_max_mesh_store_bytes(int64_t(state.meshes.max_bytes()));
  limits->set_batch_jobs(int32_t(state.options.batch_call_jobs));
  response.set_threads(int32_t(state.options.threads > 0 ? state.options.threads : CpuCount()));
  for (const DeviceReport& report : devices) {
    v1::Device* device = response.add_devices();
    device->set_name(std::string(report.backend->device()));
    device->set_backend(BackendNamed(report.backend->name()));
    device->set_model(report.backend->model());
    device->set_memory_bytes(int64_t(report.backend->memory_bytes()));
    device->set_workers(int32_t(report.workers));
    device->set_state(report.serving ? v1::DEVICE_STATE_SERVING : v1::DEVICE_STATE_QUARANTINED);
    device->set_reason(CleanText(report.reason, kMaxReasonBytes));
  }
  for (const OutputFormat& format : OutputFormats()) {
    v1::ExportFormat* out = response.add_formats();
    out->set_name(std::string(format.name));
    out->set_title(std::string(format.title));
    out->set_sparse(format.sparse);
    out->set_buckets(format.buckets);
    out->set_archive(format.directory);
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

grpc::ServerWriteReactor<grpc::ByteBuffer>* VoxelizationServiceImpl::Voxelize(grpc::CallbackServerContext* context,
                                                                              const grpc::ByteBuffer* request) {
  using Reactor = grpc::ServerWriteReactor<grpc::ByteBuffer>;
  if (Reactor* refused = RefusedCall<Reactor>::CreateIfFull(state_, *context, Rpc::kVoxelize)) return refused;
  return VoxelizeCall::Create(state_, *context, OwnRequest(request));
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizationServiceImpl::VoxelizeUpload(
    grpc::CallbackServerContext* context) {
  using Reactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;
  if (Reactor* refused = RefusedCall<Reactor>::CreateIfFull(state_, *context, Rpc::kVoxelizeUpload)) return refused;
  return VoxelizeUploadCall::Create(state_, *context);
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizationServiceImpl::VoxelizeBatch(
    grpc::CallbackServerContext* context) {
  return BatchCall::Create(state_, *context);
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* VoxelizationServiceImpl::ExportFile(grpc::CallbackServerContext* context,
                                                                                const grpc::ByteBuffer* request) {
  using Reactor = grpc::ServerWriteReactor<grpc::ByteBuffer>;
  if (Reactor* refused = RefusedCall<Reactor>::CreateIfFull(state_, *context, Rpc::kExportFile)) return refused;
  return ExportFileCall::Create(state_, *context, OwnRequest(request));
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::EstimateVoxelization(grpc::CallbackServerContext* context,
                                                                        const grpc::ByteBuffer* request,
                                                                        grpc::ByteBuffer* response) {
  return EstimateCall::Create(state_, *context, OwnRequest(request), *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::CreateMesh(grpc::CallbackServerContext* context,
                                                              const grpc::ByteBuffer* request,
                                                              grpc::ByteBuffer* response) {
  return CreateMeshCall::Create(state_, *context, OwnRequest(request), *response);
}

grpc::ServerReadReactor<grpc::ByteBuffer>* VoxelizationServiceImpl::UploadMesh(grpc::CallbackServerContext* context,
                                                                               grpc::ByteBuffer* response) {
  return UploadMeshCall::Create(state_, *context, *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetMesh(grpc::CallbackServerContext* context,
                                                           const grpc::ByteBuffer* request,
                                                           grpc::ByteBuffer* response) {
  return Answer<v1::GetMeshRequest, v1::Mesh>(
      context, Rpc::kGetMesh, request, response,
      [&](const CallRecord&, const auto& in, auto& out) { return voxelpipe::GetMesh(state_, in, out); });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::ListMeshes(grpc::CallbackServerContext* context,
                                                              const grpc::ByteBuffer* request,
                                                              grpc::ByteBuffer* response) {
  return Answer<v1::ListMeshesRequest, v1::ListMeshesResponse>(
      context, Rpc::kListMeshes, request, response, [&](const CallRecord& record, const auto& in, auto& out) {
        return voxelpipe::ListMeshes(state_, record, in, out);
      });
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::ReleaseMesh(grpc::CallbackServerContext* context,
                                                               const grpc::ByteBuffer* request,
                                                               grpc::ByteBuffer* response) {
  return Answer<v1::ReleaseMeshRequest, v1::ReleaseMeshResponse>(
      context, Rpc::kReleaseMesh, request, response, [&](const CallRecord& record, const auto& in, auto& out) {
        return voxelpipe::ReleaseMesh(state_, record, in, out);
      });
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
