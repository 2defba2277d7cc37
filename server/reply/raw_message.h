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
// Bytes of each of the first kMaxPlacedMeshes placed meshes that do not count either: all but its texts and its matrix,
// which count as mesh bytes, and but for fields of other versions that would take much more memory than bytes.
inline constexpr size_t kPlacedMeshBytes = 128;

// The way to a field with mesh bytes.
struct MeshPath {
  // The numbers of the fields in which it lies, from the message inwards, then its own; 0 after the last. kInside at
  // the end: no field, but what lies within the one before.
  static constexpr int kInside = -1;
  std::array<int, 8> fields;
  size_t placed_depth = 0;  // the index in `fields` of that of a PlacedMesh; 0: it lies in none
};

// Of the fields with mesh bytes in a MeshSource, to which `mesh` leads. The last one is that of new positions.
template <typename... Fields>
constexpr std::array<MeshPath, 8> MeshPathsOf(Fields... mesh) {
  constexpr size_t kPlaced = sizeof...(mesh) + 1;
  const auto placed = [=](auto... fields) {
    return MeshPath{{mesh..., v1::MeshSource::kPlacedFieldNumber, v1::PlacedMeshes::kMeshesFieldNumber, fields...},
                    kPlaced};
  };
  const auto motion = [=](int vec) { return placed(v1::PlacedMesh::kMotionFieldNumber, vec, MeshPath::kInside); };
  return {MeshPath{{mesh..., v1::MeshSource::kBytesFieldNumber, v1::MeshBytes::kDataFieldNumber}},
          placed(v1::PlacedMesh::kMeshFieldNumber),
          placed(v1::PlacedMesh::kMatrixFieldNumber),
          placed(v1::PlacedMesh::kNameFieldNumber),
          motion(v1::RigidMotion::kLinearFieldNumber),
          motion(v1::RigidMotion::kAngularFieldNumber),
          motion(v1::RigidMotion::kCenterFieldNumber),
          MeshPath{{mesh..., v1::MeshSource::kStoredFieldNumber, v1::StoredMesh::kPositionsFieldNumber,
                    v1::MeshPositions::kDataFieldNumber}}};
}
// The first paths of a list.
template <size_t N, size_t M>
constexpr std::array<MeshPath, N> First(const std::array<MeshPath, M>& paths) {
  std::array<MeshPath, N> first{};
  for (size_t i = 0; i < N; ++i) first[i] = paths[i];
  return first;
}
// A list with one path more.
template <size_t N>
constexpr std::array<MeshPath, N + 1> And(const std::array<MeshPath, N>& paths, const MeshPath& more) {
  std::array<MeshPath, N + 1> all{};
  for (size_t i = 0; i < N; ++i) all[i] = paths[i];
  all[N] = more;
  return all;
}
template <typename Message>
inline constexpr std::array<MeshPath, 0> kMeshPaths;
template <>
inline constexpr auto kMeshPaths<v1::VoxelizeRequest> = MeshPathsOf(v1::VoxelizeRequest::kMeshFieldNumber);
template <>
inline constexpr auto kMeshPaths<v1::VoxelizeUploadRequest> =
    And(MeshPathsOf(v1::VoxelizeUploadRequest::kRequestFieldNumber, v1::VoxelizeRequest::kMeshFieldNumber),
        MeshPath{{v1::VoxelizeUploadRequest::kPieceFieldNumber}});
template <>
inline constexpr auto kMeshPaths<v1::VoxelizeBatchRequest> = MeshPathsOf(v1::VoxelizeBatchRequest::kJobsFieldNumber,
                                                                         v1::BatchJob::kRequestFieldNumber,
                                                                         v1::VoxelizeRequest::kMeshFieldNumber);
template <>
inline constexpr auto kMeshPaths<v1::ExportFileRequest> = MeshPathsOf(v1::ExportFileRequest::kRequestFieldNumber,
                                                                      v1::VoxelizeRequest::kMeshFieldNumber);
// It takes no new positions.
template <>
inline constexpr auto kMeshPaths<v1::EstimateVoxelizationRequest> =
    First<7>(MeshPathsOf(v1::EstimateVoxelizationRequest::kMeshFieldNumber));
template <>
inline constexpr std::array<MeshPath, 1> kMeshPaths<v1::CreateMeshRequest>{
    MeshPath{{v1::CreateMeshRequest::kMeshFieldNumber, v1::MeshBytes::kDataFieldNumber}}};
template <>
inline constexpr std::array<MeshPath, 1> kMeshPaths<v1::UploadMeshRequest>{
    MeshPath{{v1::UploadMeshRequest::kPieceFieldNumber}}};

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
