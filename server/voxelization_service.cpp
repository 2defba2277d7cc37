#include "voxelization_service.h"

#include "calls/estimate_call.h"
#include "calls/voxelize_call.h"
#include "pipeline/backend.h"
#include "shaders/catalog.h"
#include "wire/response.h"

namespace voxelpipe {

grpc::ServerBidiReactor<v1::VoxelizeRequest, v1::VoxelizeResponse>* VoxelizationServiceImpl::Voxelize(
    grpc::CallbackServerContext* context) {
  return VoxelizeCall::Create(state_, *context);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::EstimateVoxelization(grpc::CallbackServerContext* context,
                                                                        const v1::EstimateVoxelizationRequest* request,
                                                                        v1::EstimateVoxelizationResponse* response) {
  return EstimateCall::Create(state_, *context, *request, *response);
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::ListShaders(grpc::CallbackServerContext* context,
                                                               const v1::ListShadersRequest* /*request*/,
                                                               v1::ListShadersResponse* response) {
  for (const ShaderInfo& shader : voxelpipe::ListShaders()) *response->add_shaders() = ToMessage(shader);
  return Answered(context, "ListShaders");
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::GetServerInfo(grpc::CallbackServerContext* context,
                                                                 const v1::GetServerInfoRequest* /*request*/,
                                                                 v1::GetServerInfoResponse* response) {
  response->set_version(VOXELPIPE_VERSION);
  for (const std::string& name : AvailableBackends()) {
    const auto backend = SelectBackend(name == "cuda" ? BackendChoice::kCuda : BackendChoice::kCpu);
    if (!backend.ok()) continue;
    v1::BackendInfo* info = response->add_backends();
    info->set_name(name);
    info->set_simd(std::string((*backend)->simd()));
  }
  v1::ServerLimits* limits = response->mutable_limits();
  limits->set_max_file_bytes(state_.limits.load.max_file_bytes);
  limits->set_max_result_bytes(state_.limits.plan.max_result_bytes);
  limits->set_max_working_bytes(state_.limits.plan.max_working_bytes);
  limits->set_max_triangles(state_.limits.load.max_triangles);
  limits->set_max_message_bytes(kMaxMessageBytes);
  limits->set_workers(uint32_t(state_.options.workers));
  limits->set_max_queue(state_.options.max_queue);
  response->set_threads(uint32_t(state_.options.threads));
  return Answered(context, "GetServerInfo");
}

grpc::ServerUnaryReactor* VoxelizationServiceImpl::Answered(grpc::CallbackServerContext* context, const char* method) {
  CallRecord(state_.next_request_id++, method, context->peer()).Log(absl::OkStatus());
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

}  // namespace voxelpipe
