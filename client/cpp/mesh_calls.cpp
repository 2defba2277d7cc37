#include "mesh_calls.h"

#include <algorithm>
#include <memory>

#include <grpcpp/client_context.h>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "call_watch.h"
#include "upload_pieces.h"
#include "wire/count.h"
#include "wire/mesh_name.h"
#include "wire/request.h"
#include "wire/response.h"

namespace voxelpipe {

absl::StatusOr<StoredMesh> FromMessage(const v1::Mesh& message) {
  if (const absl::Status s = CheckMeshName(message.name(), "name"); !s.ok()) {
    return absl::DataLossError(
        absl::StrCat("the server's answer: '", absl::CHexEscape(message.name()), "', ", std::string(s.message())));
  }
  StoredMesh mesh;
  mesh.name = message.name();
  // A newer server may have others.
  const MeshFileType type = ParseMeshType(message.format(), message.unit(), "").value_or(MeshFileType{});
  mesh.format = type.format;
  mesh.unit = type.unit;
  mesh.file_bytes = CountOf(message.file_bytes());
  mesh.memory_bytes = CountOf(message.memory_bytes());
  mesh.report = FromMessage(message.report());
  mesh.warnings = ReadWarnings(message);
  mesh.uses = CountOf(message.uses());
  mesh.already_stored = message.already_stored();
  return mesh;
}

absl::StatusOr<StoredMesh> CallUploadMesh(const RawCalls& calls, const std::string& target,
                                          std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                          const JobContext& job) {
  if (absl::Status status = job.Check(); !status.ok()) return status;
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  v1::Mesh response;
  const auto stream = calls.UploadMesh(context, response);
  v1::UploadMeshRequest message;
  const std::string name = MeshNameOf(mesh_bytes, type);
  message.mutable_upload()->set_format(ToMessage(type.format));
  message.mutable_upload()->set_unit(ToMessage(type.unit));
  message.mutable_upload()->set_expected_id(name);
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
  absl::StatusOr<StoredMesh> mesh = FromMessage(response);
  if (mesh.ok() && mesh->name != name) {
    return absl::DataLossError(absl::StrCat("the server keeps the mesh ", name, " as ", mesh->name));
  }
  return mesh;
}

}  // namespace voxelpipe
