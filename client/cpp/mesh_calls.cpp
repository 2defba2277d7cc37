#include "mesh_calls.h"

#include <algorithm>
#include <memory>

#include <grpcpp/client_context.h>

#include "absl/strings/str_cat.h"
#include "call_watch.h"
#include "upload_pieces.h"
#include "wire/mesh_id.h"
#include "wire/request.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

constexpr size_t kMeshIdDigits = 64;

}  // namespace

absl::StatusOr<StoredMesh> FromMessage(const v1::StoredMesh& message) {
  if (message.mesh_id().size() != kMeshIdDigits) {
    return absl::DataLossError(absl::StrCat("the server's answer: '", message.mesh_id(), "' names no mesh"));
  }
  StoredMesh mesh;
  mesh.mesh_id = message.mesh_id();
  // A newer server may have others.
  const MeshFileType type = ParseMeshType(message.mesh_format(), message.mesh_unit()).value_or(MeshFileType{});
  mesh.format = type.format;
  mesh.unit = type.unit;
  mesh.file_bytes = message.file_bytes();
  mesh.memory_bytes = message.memory_bytes();
  mesh.report = FromMessage(message.mesh());
  mesh.warnings = ReadWarnings(message);
  mesh.uses = message.uses();
  return mesh;
}

absl::StatusOr<StoredMesh> CallUploadMesh(const RawCalls& calls, const std::string& target,
                                          std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                          const JobContext& job) {
  if (absl::Status status = job.Check(); !status.ok()) return status;
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  v1::UploadMeshResponse response;
  const auto stream = calls.UploadMesh(context, response);
  v1::UploadMeshRequest message;
  const std::string mesh_id = MeshIdOf(mesh_bytes, type.unit);
  message.mutable_upload()->set_mesh_format(ToMessage(type.format));
  message.mutable_upload()->set_mesh_unit(ToMessage(type.unit));
  message.mutable_upload()->set_mesh_id(mesh_id);
  bool open =
      stream->Write(Serialized(message));  // false as soon as the server has responded: it has or refuses the mesh
  UploadPieces pieces(v1::UploadMeshRequest::kPieceFieldNumber, v1::UploadMeshRequest::kCrc32CFieldNumber);
  for (size_t offset = 0; open && offset < mesh_bytes.size(); offset += kUploadPieceBytes) {
    job.Report("upload", double(offset) / double(mesh_bytes.size()));
    const size_t bytes = std::min(kUploadPieceBytes, mesh_bytes.size() - offset);
    open = stream->Write(pieces.Make(mesh_bytes.subspan(offset, bytes)));
  }
  if (open) stream->WritesDone();
  const grpc::Status status = stream->Finish();
  if (!status.ok()) return CallStatus(status, job, target);
  job.Report("upload", 1);
  absl::StatusOr<StoredMesh> mesh = FromMessage(response.mesh());
  if (!mesh.ok()) return mesh;
  if (mesh->mesh_id != mesh_id) {
    return absl::DataLossError(absl::StrCat("the server keeps the mesh ", mesh_id, " as ", mesh->mesh_id));
  }
  mesh->already_stored = response.already_stored();
  return mesh;
}

}  // namespace voxelpipe
