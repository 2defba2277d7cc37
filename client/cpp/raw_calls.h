// The calls with many bytes, on raw gRPC buffers: parsed in place, where generated stubs would parse and copy.
#pragma once

#include <memory>

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/impl/codegen/rpc_method.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/sync_stream.h>

#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// Thread-safe, like a generated stub.
class RawCalls {
 public:
  explicit RawCalls(std::shared_ptr<grpc::Channel> channel);

  // VoxelizeRequest up, VoxelizeResponse down.
  std::unique_ptr<grpc::ClientReader<grpc::ByteBuffer>> Voxelize(grpc::ClientContext& context,
                                                                 const grpc::ByteBuffer& request) const;

  // VoxelizeUploadRequest up, VoxelizeResponse down.
  using UploadStream = grpc::ClientReaderWriter<grpc::ByteBuffer, grpc::ByteBuffer>;
  std::unique_ptr<UploadStream> VoxelizeUpload(grpc::ClientContext& context) const;

  // UploadMeshRequest up.
  std::unique_ptr<grpc::ClientWriter<grpc::ByteBuffer>> UploadMesh(grpc::ClientContext& context,
                                                                   v1::Mesh& response) const;

 private:
  const std::shared_ptr<grpc::Channel> channel_;
  const grpc::internal::RpcMethod voxelize_, voxelize_upload_, upload_mesh_;
};

}  // namespace voxelpipe
