// Messages as gRPC has them, read with a bound on what reading them takes, and written.
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

// Of a request message, all but its mesh bytes. What consists of empty fields takes some sixty times its bytes once it
// has been read.
inline constexpr size_t kMaxSettingsBytes = 1 << 20;

// Which fields of a message are mesh bytes: one of its own, and one of each message in its field `inner`. 0: none.
struct MeshFields {
  int own = 0, inner = 0, of_inner = 0;
};
template <typename Message>
inline constexpr MeshFields kMeshFields;
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeRequest>{v1::VoxelizeRequest::kMeshPieceFieldNumber,
                                                             v1::VoxelizeRequest::kWholeFieldNumber,
                                                             v1::WholeRequest::kMeshFieldNumber};
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeWholeRequest>{v1::VoxelizeWholeRequest::kMeshFieldNumber, 0, 0};
template <>
inline constexpr MeshFields kMeshFields<v1::VoxelizeManyRequest>{v1::VoxelizeManyRequest::kMeshFieldNumber,
                                                                 v1::VoxelizeManyRequest::kMoreFieldNumber,
                                                                 v1::VoxelizeManyRequest::kMeshFieldNumber};
template <>
inline constexpr MeshFields kMeshFields<v1::EstimateVoxelizationRequest>{
    v1::EstimateVoxelizationRequest::kMeshBytesFieldNumber, 0, 0};
template <>
inline constexpr MeshFields kMeshFields<v1::UploadMeshRequest>{v1::UploadMeshRequest::kPieceFieldNumber, 0, 0};

// INVALID_ARGUMENT where a message has more than kMaxSettingsBytes beside its mesh bytes, or breaks on the way there.
// Takes nothing off `bytes`, allocates nothing.
absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, const MeshFields& fields);

// In: `bytes`, of which nothing is left. Out: `message`. INVALID_ARGUMENT where they are none, or hold more than is
// possible.
template <typename Message>
absl::Status ReadMessage(grpc::ByteBuffer& bytes, Message& message) {
  absl::Status status = CheckSettingsBytes(bytes, kMeshFields<Message>);
  if (status.ok() && !grpc::SerializationTraits<Message>::Deserialize(&bytes, &message).ok()) {
    status = absl::InvalidArgumentError(absl::StrCat("message: not a ", Message::descriptor()->name()));
  }
  bytes.Clear();
  return status;
}

// The request of a call that gRPC made for this call alone and does not look at again: reading it frees its bytes.
inline grpc::ByteBuffer& OwnRequest(const grpc::ByteBuffer* request) {
  return *const_cast<grpc::ByteBuffer*>(request);
}

template <typename Message>
void WriteMessage(const Message& message, grpc::ByteBuffer& bytes) {
  bool own = false;
  grpc::SerializationTraits<Message>::Serialize(message, &bytes, &own);
}

}  // namespace voxelpipe
