#include "raw_calls.h"

#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

namespace voxelpipe {
namespace {

using grpc::ByteBuffer;
using grpc::internal::RpcMethod;

constexpr char kVoxelize[] = "/voxelpipe.v1.VoxelizationService/Voxelize";
constexpr char kVoxelizeUpload[] = "/voxelpipe.v1.VoxelizationService/VoxelizeUpload";
constexpr char kUploadMesh[] = "/voxelpipe.v1.VoxelizationService/UploadMesh";

}  // namespace

RawCalls::RawCalls(std::shared_ptr<grpc::Channel> channel)
    : channel_(std::move(channel)),
      voxelize_(kVoxelize, nullptr, RpcMethod::SERVER_STREAMING, channel_),
      voxelize_upload_(kVoxelizeUpload, nullptr, RpcMethod::BIDI_STREAMING, channel_),
      upload_mesh_(kUploadMesh, nullptr, RpcMethod::CLIENT_STREAMING, channel_) {}

std::unique_ptr<grpc::ClientReader<ByteBuffer>> RawCalls::Voxelize(grpc::ClientContext& context,
                                                                   const ByteBuffer& request) const {
  return std::unique_ptr<grpc::ClientReader<ByteBuffer>>(
      grpc::internal::ClientReaderFactory<ByteBuffer>::Create(channel_.get(), voxelize_, &context, request));
}

std::unique_ptr<RawCalls::UploadStream> RawCalls::VoxelizeUpload(grpc::ClientContext& context) const {
  return std::unique_ptr<UploadStream>(grpc::internal::ClientReaderWriterFactory<ByteBuffer, ByteBuffer>::Create(
      channel_.get(), voxelize_upload_, &context));
}

std::unique_ptr<grpc::ClientWriter<ByteBuffer>> RawCalls::UploadMesh(grpc::ClientContext& context,
                                                                     v1::Mesh& response) const {
  return std::unique_ptr<grpc::ClientWriter<ByteBuffer>>(
      grpc::internal::ClientWriterFactory<ByteBuffer>::Create(channel_.get(), upload_mesh_, &context, &response));
}

}  // namespace voxelpipe
