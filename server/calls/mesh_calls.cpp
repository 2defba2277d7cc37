#include "calls/mesh_calls.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "reply/raw_message.h"
#include "wire/mesh_name.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr int kPageSize = 100, kMaxPageSize = 1000;

// Frees a mesh without other users.
class FreeTask final : public Task {
 public:
  explicit FreeTask(std::shared_ptr<KeptMesh> mesh) : mesh_(std::move(mesh)) {}
  bool loaded() const override { return false; }
  bool Load() override {
    mesh_.reset();
    return false;
  }
  void Refuse(absl::Status /*why*/) override {}

 private:
  std::shared_ptr<KeptMesh> mesh_;
};

// Freeing gigabytes takes long: not on gRPC's thread, unless all loaders are overloaded.
void Free(ServiceState& state, std::shared_ptr<KeptMesh> mesh) {
  state.scheduler.Submit(std::make_shared<FreeTask>(std::move(mesh))).IgnoreError();
}

}  // namespace

CreateMeshCall* CreateMeshCall::Create(ServiceState& state, grpc::CallbackServerContext& context,
                                       grpc::ByteBuffer& request, grpc::ByteBuffer& response) {
  std::shared_ptr<CreateMeshCall> call(new CreateMeshCall(state, context, response));
  call->self_ = call;
  absl::Status status = MayBegin(call->pass_, call->record_.admission());
  if (status.ok()) status = call->TakeMessage(request);
  if (status.ok()) {
    call->SubmitFile();
  } else {
    call->Answer(status, false);
  }
  return call.get();
}

CreateMeshCall::CreateMeshCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response)
    : MeshUpload(state, context, Rpc::kCreateMesh, response) {}

absl::Status CreateMeshCall::TakeMessage(grpc::ByteBuffer& bytes) {
  v1::CreateMeshRequest message;
  if (absl::Status s = ReadMessage(bytes, message); !s.ok()) return s;
  v1::MeshBytes& mesh = *message.mutable_mesh();
  const absl::StatusOr<MeshFileType> type = ParseMeshType(mesh.format(), mesh.unit(), "mesh.");
  if (!type.ok()) return type.status();
  type_ = *type;
  const std::lock_guard lock(mutex_);
  return TakePiece(std::move(*mesh.mutable_data()), mesh.has_crc32c() ? std::optional(mesh.crc32c()) : std::nullopt);
}

UploadMeshCall* UploadMeshCall::Create(ServiceState& state, grpc::CallbackServerContext& context,
                                       grpc::ByteBuffer& response) {
  std::shared_ptr<UploadMeshCall> call(new UploadMeshCall(state, context, response));
  call->self_ = call;
  call->upload_wait_ = std::make_unique<IdleWatch::Wait>(
      state.idle_watch, std::chrono::milliseconds(state.options.upload_idle_timeout_ms),
      [weak = std::weak_ptr<UploadMeshCall>(call)] {
        if (const auto self = weak.lock()) self->GiveUp();
      });
  if (absl::Status s = MayBegin(call->pass_, call->record_.admission()); s.ok()) {
    call->upload_wait_->Begin();
    call->StartRead(&call->read_);
  } else {
    call->Answer(s, false);
  }
  return call.get();
}

UploadMeshCall::UploadMeshCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response)
    : MeshUpload(state, context, Rpc::kUploadMesh, response) {}

void UploadMeshCall::OnReadDone(bool ok) {
  if (!ok) {
    upload_wait_->End();
    UploadEnded();
    return;
  }
  absl::Status taken;
  {
    v1::UploadMeshRequest message;  // freed before the next one arrives: an open upload holds only its mesh
    taken = ReadMessage(read_, message);
    if (taken.ok()) {
      const std::lock_guard lock(mutex_);  // the idle watch may end the call concurrently
      if (answered_) return;
      taken = TakeMessage(message);
    }
  }
  if (!taken.ok()) {
    upload_wait_->End();
    Answer(taken, false);
    return;
  }
  if (!expected_name_.empty() && record_.bytes_in == 0) {
    if (std::shared_ptr<KeptMesh> mesh = state_.meshes.Touch(expected_name_)) {
      upload_wait_->End();
      Answer(std::move(mesh), true);
      return;
    }
  }
  if (record_.bytes_in - upload_bytes_seen_ >= kMinUploadBytes) {
    upload_bytes_seen_ = record_.bytes_in;
    upload_wait_->Begin();
  }
  StartRead(&read_);
}

absl::Status UploadMeshCall::TakeMessage(v1::UploadMeshRequest& message) {
  switch (message.message_case()) {
    case v1::UploadMeshRequest::kUpload: return TakeUpload(message.upload());
    case v1::UploadMeshRequest::kPiece:
      if (!begun_) return absl::InvalidArgumentError("upload: must come before the pieces");
      return TakePiece(std::move(*message.mutable_piece()),
                       message.has_crc32c() ? std::optional(message.crc32c()) : std::nullopt);
    default: return absl::InvalidArgumentError("message: neither an upload nor a piece");
  }
}

absl::Status UploadMeshCall::TakeUpload(const v1::MeshUpload& upload) {
  if (std::exchange(begun_, true)) return absl::InvalidArgumentError("upload: only the first message may be one");
  const absl::StatusOr<MeshFileType> type = ParseMeshType(upload.format(), upload.unit(), "upload.");
  if (!type.ok()) return type.status();
  type_ = *type;
  if (upload.expected_id().empty()) return absl::OkStatus();
  expected_name_ = upload.expected_id();
  return CheckMeshName(expected_name_, "upload.expected_id");
}

void UploadMeshCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (job_.Check().ok()) job_.Cancel();
    Answer(job_.Check(), false);
  } else if (!begun_) {
    Answer(absl::InvalidArgumentError("upload: the stream ended without one"), false);
  } else {
    SubmitFile();
  }
}

void UploadMeshCall::GiveUp() {
  if (job_.Check().ok()) job_.Cancel();
  Answer(absl::AbortedError(
             absl::StrCat("the client sent too little of its mesh for ", state_.options.upload_idle_timeout_ms, " ms")),
         false);
}

absl::Status GetMesh(ServiceState& state, const v1::GetMeshRequest& request, v1::Mesh& response) {
  if (absl::Status s = CheckMeshName(request.name(), "name"); !s.ok()) return s;
  const absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Get(request.name());
  if (!mesh.ok()) return mesh.status();
  response = ToMessage(**mesh);
  return absl::OkStatus();
}

absl::Status ListMeshes(ServiceState& state, const CallRecord& caller, const v1::ListMeshesRequest& request,
                        v1::ListMeshesResponse& response) {
  if (request.page_size() < 0) return absl::InvalidArgumentError("page_size: must not be negative");
  const size_t size = size_t(request.page_size() == 0 ? kPageSize : std::min(request.page_size(), kMaxPageSize));
  std::optional<uint64_t> before;
  if (const std::string& token = request.page_token(); !token.empty()) {
    const char* const end = token.data() + token.size();
    const auto [rest, error] = std::from_chars(token.data(), end, before.emplace());
    if (error != std::errc() || rest != end) {
      return absl::InvalidArgumentError("page_token: is not one that this server gave");
    }
  }
  const bool all = caller.role() == Role::kAdmin;
  std::vector<MeshStore::Listed> meshes = state.meshes.List(all ? nullptr : &caller.client, before, size + 1);
  if (meshes.size() > size) {
    meshes.resize(size);
    response.set_next_page_token(absl::StrCat(meshes.back().number));
  }
  for (const MeshStore::Listed& mesh : meshes) *response.add_meshes() = ToMessage(*mesh.value);
  return absl::OkStatus();
}

absl::Status ReleaseMesh(ServiceState& state, const CallRecord& caller, const v1::ReleaseMeshRequest& request,
                         v1::ReleaseMeshResponse& response) {
  if (absl::Status s = CheckMeshName(request.name(), "name"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Release(request.name(), caller.client);
  if (!mesh.ok()) return mesh.status();
  if (*mesh == nullptr) {
    response.set_kept_for_others(true);
    return absl::OkStatus();
  }
  response.set_freed_bytes(int64_t((*mesh)->memory_bytes()));
  Free(state, *std::move(mesh));
  return absl::OkStatus();
}

absl::Status DeleteMesh(ServiceState& state, const CallRecord& caller, const v1::DeleteMeshRequest& request,
                        v1::DeleteMeshResponse& response) {
  if (caller.role() != Role::kAdmin) {
    return absl::PermissionDeniedError("DeleteMesh is for administrators; ReleaseMesh gives up the caller's own claim");
  }
  if (absl::Status s = CheckMeshName(request.name(), "name"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Delete(request.name());
  if (!mesh.ok()) return mesh.status();
  response.set_freed_bytes(int64_t((*mesh)->memory_bytes()));
  Free(state, *std::move(mesh));
  return absl::OkStatus();
}

}  // namespace voxelpipe
