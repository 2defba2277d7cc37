// The service: which call is answered by what.
#pragma once

#include <functional>

#include <grpcpp/grpcpp.h>

#include "calls/call_record.h"
#include "service_state.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe {

// These send and receive bytes as gRPC has them, so that results go out from where they stand.
template <typename Base>
using WithRawCalls =
    v1::VoxelizationService::WithRawCallbackMethod_Voxelize<v1::VoxelizationService::WithRawCallbackMethod_VoxelizeMany<
        v1::VoxelizationService::WithRawCallbackMethod_VoxelizeWhole<Base>>>;
template <typename Base>
using WithTypedCalls = v1::VoxelizationService::WithCallbackMethod_EstimateVoxelization<
    v1::VoxelizationService::WithCallbackMethod_ListShaders<v1::VoxelizationService::WithCallbackMethod_GetServerInfo<
        v1::VoxelizationService::WithCallbackMethod_UploadMesh<v1::VoxelizationService::WithCallbackMethod_GetMesh<
            v1::VoxelizationService::WithCallbackMethod_DeleteMesh<Base>>>>>>;

class VoxelizationServiceImpl final : public WithRawCalls<WithTypedCalls<v1::VoxelizationService::Service>> {
 public:
  // `state` must outlive the service.
  explicit VoxelizationServiceImpl(ServiceState& state) : state_(state) {}

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Voxelize(grpc::CallbackServerContext* context) override;
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizeMany(
      grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* VoxelizeWhole(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                          grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* EstimateVoxelization(grpc::CallbackServerContext* context,
                                                 const v1::EstimateVoxelizationRequest* request,
                                                 v1::EstimateVoxelizationResponse* response) override;
  grpc::ServerReadReactor<v1::UploadMeshRequest>* UploadMesh(grpc::CallbackServerContext* context,
                                                             v1::UploadMeshResponse* response) override;
  grpc::ServerUnaryReactor* GetMesh(grpc::CallbackServerContext* context, const v1::GetMeshRequest* request,
                                    v1::GetMeshResponse* response) override;
  grpc::ServerUnaryReactor* DeleteMesh(grpc::CallbackServerContext* context, const v1::DeleteMeshRequest* request,
                                       v1::DeleteMeshResponse* response) override;
  grpc::ServerUnaryReactor* ListShaders(grpc::CallbackServerContext* context, const v1::ListShadersRequest* request,
                                        v1::ListShadersResponse* response) override;
  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context, const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override;

 private:
  // Answers a call that needs no job: `fill` writes the response, if the caller may have it, and says how the call ends.
  grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, Rpc rpc,
                                   const std::function<absl::Status(const CallRecord&)>& fill);

  ServiceState& state_;
};

}  // namespace voxelpipe
