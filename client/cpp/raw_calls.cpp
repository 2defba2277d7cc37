#include "raw_calls.h"

#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

namespace voxelpipe {
namespace {

using grpc::ByteBuffer;
using grpc::internal::RpcMethod;

constexpr char kVoxelize[] = "/voxelpipe.v1.VoxelizationService/Voxelize";
constexpr char kVoxelizeMesh[] = "/voxelpipe.v1.VoxelizationService/VoxelizeMesh";
constexpr char kUploadMesh[] = "/voxelpipe.v1.VoxelizationService/UploadMesh";

}  // namespace

RawCalls::RawCalls(std::shared_ptr<grpc::Channel> channel)
    : channel_(std::move(channel)),
      voxelize_(kVoxelize, nullptr, RpcMethod::BIDI_STREAMING, channel_),
      voxelize_mesh_(kVoxelizeMesh, nullptr, RpcMethod::SERVER_STREAMING, channel_),
      upload_mesh_(kUploadMesh, nullptr, RpcMethod::CLIENT_STREAMING, channel_) {}

std::unique_ptr<RawCalls::VoxelizeStream> RawCalls::Voxelize(grpc::ClientContext& context) const {
  return std::unique_ptr<VoxelizeStream>(
      grpc::internal::ClientReaderWriterFactory<ByteBuffer, ByteBuffer>::Create(channel_.get(), voxelize_, &context));
}

std::unique_ptr<RawCalls::VoxelizeMeshStream> RawCalls::VoxelizeMesh(grpc::ClientContext& context,
                                                                     const ByteBuffer& request) const {
  return std::unique_ptr<VoxelizeMeshStream>(
      grpc::internal::ClientReaderFactory<ByteBuffer>::Create(channel_.get(), voxelize_mesh_, &context, request));
}

std::unique_ptr<grpc::ClientWriter<ByteBuffer>> RawCalls::UploadMesh(grpc::ClientContext& context,
                                                                     v1::UploadMeshResponse& response) const {
  return std::unique_ptr<grpc::ClientWriter<ByteBuffer>>(
      grpc::internal::ClientWriterFactory<ByteBuffer>::Create(channel_.get(), upload_mesh_, &context, &response));
}

}  // namespace voxelpipe
