// Raw gRPC messages: parsing with a bound on memory, and serialization.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include <google/protobuf/message.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// The limit of a request message without its mesh bytes. Empty fields take about sixty times their bytes after parsing.
inline constexpr size_t kMaxSettingsBytes = 1 << 20;

// The way to a field with mesh bytes: the numbers of the fields in which it lies, from the message inwards, then its
// own; 0 after the last.
using MeshPath = std::array<int, 6>;
// Of the fields with mesh bytes in a request: `prefix` leads to the VoxelizeRequest.
template <typename... Prefix>
constexpr std::array<MeshPath, 2> MeshPathsOf(Prefix... prefix) {
  return {MeshPath{prefix..., v1::VoxelizeRequest::kMeshFieldNumber, v1::MeshSource::kBytesFieldNumber,
                   v1::MeshBytes::kDataFieldNumber},
          MeshPath{prefix..., v1::VoxelizeRequest::kMeshFieldNumber, v1::MeshSource::kStoredFieldNumber,
                   v1::StoredMesh::kPositionsFieldNumber, v1::MeshPositions::kDataFieldNumber}};
}
template <typename Message>
inline constexpr std::array<MeshPath, 0> kMeshPaths;
template <>
inline constexpr auto kMeshPaths<v1::VoxelizeRequest> = MeshPathsOf();
template <>
inline constexpr std::array<MeshPath, 3> kMeshPaths<v1::VoxelizeUploadRequest>{
    MeshPath{v1::VoxelizeUploadRequest::kPieceFieldNumber},
    MeshPathsOf(v1::VoxelizeUploadRequest::kRequestFieldNumber)[0],
    MeshPathsOf(v1::VoxelizeUploadRequest::kRequestFieldNumber)[1]};
template <>
inline constexpr auto kMeshPaths<v1::VoxelizeBatchRequest> = MeshPathsOf(v1::VoxelizeBatchRequest::kJobsFieldNumber,
                                                                         v1::BatchJob::kRequestFieldNumber);
template <>
inline constexpr auto kMeshPaths<v1::ExportFileRequest> = MeshPathsOf(v1::ExportFileRequest::kRequestFieldNumber);
template <>
inline constexpr std::array<MeshPath, 1> kMeshPaths<v1::EstimateVoxelizationRequest>{
    MeshPath{v1::EstimateVoxelizationRequest::kMeshFieldNumber, v1::MeshSource::kBytesFieldNumber,
             v1::MeshBytes::kDataFieldNumber}};
template <>
inline constexpr std::array<MeshPath, 1> kMeshPaths<v1::CreateMeshRequest>{
    MeshPath{v1::CreateMeshRequest::kMeshFieldNumber, v1::MeshBytes::kDataFieldNumber}};
template <>
inline constexpr std::array<MeshPath, 1> kMeshPaths<v1::UploadMeshRequest>{
    MeshPath{v1::UploadMeshRequest::kPieceFieldNumber}};

// INVALID_ARGUMENT if a message has more than kMaxSettingsBytes besides its mesh bytes, or is malformed before that.
// `paths`: at most 32. Does not consume `bytes`, does not allocate.
absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, std::span<const MeshPath> paths);

// Parses `message` and consumes `bytes`. INVALID_ARGUMENT if they are malformed or exceed the limit.
template <typename Message>
absl::Status ReadMessage(grpc::ByteBuffer& bytes, Message& message) {
  absl::Status status = CheckSettingsBytes(bytes, kMeshPaths<Message>);
  if (status.ok() && !grpc::SerializationTraits<Message>::Deserialize(&bytes, &message).ok()) {
    status = absl::InvalidArgumentError(absl::StrCat("message: not a ", Message::descriptor()->name()));
  }
  bytes.Clear();
  return status;
}

// The request buffer of a call, which gRPC does not read again: parsing it frees its bytes.
inline grpc::ByteBuffer& OwnRequest(const grpc::ByteBuffer* request) {
  return *const_cast<grpc::ByteBuffer*>(request);
}

template <typename Message>
void WriteMessage(const Message& message, grpc::ByteBuffer& bytes) {
  bool own = false;
  grpc::SerializationTraits<Message>::Serialize(message, &bytes, &own);
}

}  // namespace voxelpipe
