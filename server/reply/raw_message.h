// Raw gRPC messages: parsing with a bound on memory, and serialization.
#pragma once

#include <cstddef>
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

// The fields with mesh bytes: one of the message, and one of each message in its field `inner`. 0: none.
struct MeshFields {
  int own = 0, inner = 0, of_inner = 0;
};
template <typename Message>
inline constexpr MeshFields kMeshFields;
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeRequest>{v1::VoxelizeRequest::kMeshPieceFieldNumber, 0, 0};
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeMeshRequest>{v1::VoxelizeMeshRequest::kMeshFieldNumber, 0, 0};
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeManyRequest>{v1::VoxelizeManyRequest::kMeshFieldNumber,
                                                                 v1::VoxelizeManyRequest::kMoreFieldNumber,
                                                                 v1::VoxelizeManyRequest::kMeshFieldNumber};
template <>
inline constexpr MeshFields kMeshFields<v1::EstimateVoxelizationRequest>{
    v1::EstimateVoxelizationRequest::kMeshBytesFieldNumber, 0, 0};
template <>
inline constexpr MeshFields kMeshFields<v1::UploadMeshRequest>{v1::UploadMeshRequest::kPieceFieldNumber, 0, 0};

// INVALID_ARGUMENT if a message has more than kMaxSettingsBytes besides its mesh bytes, or is malformed before that.
// Does not consume `bytes`, does not allocate.
absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, const MeshFields& fields);

// Parses `message` and consumes `bytes`. INVALID_ARGUMENT if they are malformed or exceed the limit.
template <typename Message>
absl::Status ReadMessage(grpc::ByteBuffer& bytes, Message& message) {
  absl::Status status = CheckSettingsBytes(bytes, kMeshFields<Message>);
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
