// The service: dispatches its calls.
#pragma once

#include <grpcpp/grpcpp.h>

#include "calls/call_record.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe {

// All use raw gRPC buffers: results are sent without a copy, and requests that cannot be parsed are answered, logged
// and counted like any other invalid request.
using Rpcs = v1::VoxelizationService;
template <typename Base>
using WithMeshCalls = Rpcs::WithRawCallbackMethod_CreateMesh<
    Rpcs::WithRawCallbackMethod_UploadMesh<Rpcs::WithRawCallbackMethod_GetMesh<Rpcs::WithRawCallbackMethod_ListMeshes<
        Rpcs::WithRawCallbackMethod_ReleaseMesh<Rpcs::WithRawCallbackMethod_DeleteMesh<Base>>>>>>;
template <typename Base>
using WithJobCalls = Rpcs::WithRawCallbackMethod_Voxelize<Rpcs::WithRawCallbackMethod_VoxelizeUpload<
    Rpcs::WithRawCallbackMethod_VoxelizeBatch<Rpcs::WithRawCallbackMethod_ExportFile<Base>>>>;
template <typename Base>
using WithQuestions = Rpcs::WithRawCallbackMethod_EstimateVoxelization<
    Rpcs::WithRawCallbackMethod_ListShaders<Rpcs::WithRawCallbackMethod_GetServerInfo<Base>>>;

class VoxelizationServiceImpl final : public WithJobCalls<WithMeshCalls<WithQuestions<Rpcs::Service>>> {
 public:
  // `state` must outlive the service.
  explicit VoxelizationServiceImpl(ServiceState& state) : state_(state) {}

  grpc::ServerWriteReactor<grpc::ByteBuffer>* Voxelize(grpc::CallbackServerContext* context,
                                                       const grpc::ByteBuffer* request) override;
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizeUpload(
      grpc::CallbackServerContext* context) override;
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* VoxelizeBatch(
      grpc::CallbackServerContext* context) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* ExportFile(grpc::CallbackServerContext* context,
                                                         const grpc::ByteBuffer* request) override;
  grpc::ServerUnaryReactor* EstimateVoxelization(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                                 grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* CreateMesh(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* response) override;
  grpc::ServerReadReactor<grpc::ByteBuffer>* UploadMesh(grpc::CallbackServerContext* context,
                                                        grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* GetMesh(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                    grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* ListMeshes(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* ReleaseMesh(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                        grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* DeleteMesh(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* ListShaders(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                        grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                          grpc::ByteBuffer* response) override;

 private:
  // Answers a call that needs no job: `fill(record, request, response)` writes the response, if the caller is
  // authorized and the Request is valid, and sets the status of the call.
  template <typename Request, typename Response, typename Fill>
  grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, Rpc rpc, const grpc::ByteBuffer* request,
                                   grpc::ByteBuffer* response, Fill fill);

  ServiceState& state_;
};

}  // namespace voxelpipe
