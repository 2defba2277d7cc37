#include "calls/mesh_calls.h"

#include <chrono>
#include <exception>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "calls/call_setup.h"
#include "isolate/loading.h"
#include "jobs/request_memory.h"
#include "load/costly_parts.h"
#include "load/load_mesh.h"
#include "reply/raw_message.h"
#include "schedule/cost.h"
#include "wire/mesh_id.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

std::span<const uint8_t> BytesOf(const std::string& text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

// Joins the pieces, each of which is freed as soon as it is copied.
std::vector<uint8_t> Join(std::deque<std::string>& pieces, uint64_t bytes) {
  std::vector<uint8_t> file;
  file.reserve(bytes);
  for (; !pieces.empty(); pieces.pop_front()) file.insert(file.end(), pieces.front().begin(), pieces.front().end());
  return file;
}

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

}  // namespace

class UploadMeshCall::FileTask final : public Task {
 public:
  explicit FileTask(std::shared_ptr<UploadMeshCall> call) : call_(std::move(call)) {}
  bool loaded() const override { return false; }
  bool Load() override {
    call_->Work();
    return false;
  }
  void Refuse(absl::Status why) override { call_->Answer(why, false); }

 private:
  const std::shared_ptr<UploadMeshCall> call_;
};

v1::StoredMesh ToMessage(KeptMesh& mesh) {
  v1::StoredMesh message;
  message.set_mesh_id(mesh.id());
  message.set_mesh_format(ToMessage(mesh.type().format));
  message.set_mesh_unit(ToMessage(mesh.type().unit));
  message.set_file_bytes(mesh.file_bytes());
  message.set_memory_bytes(mesh.memory_bytes());
  const KeptMesh::Facts facts = mesh.Report();
  *message.mutable_mesh() = ToMessage(facts.report, facts.examined);
  WriteWarnings(facts.warnings, message);
  message.set_uses(mesh.uses());
  return message;
}

UploadMeshCall* UploadMeshCall::Create(ServiceState& state, grpc::CallbackServerContext& context,
                                       grpc::ByteBuffer& response) {
  std::shared_ptr<UploadMeshCall> call(new UploadMeshCall(state, context, response));
  call->self_ = call;
  call->upload_wait_ = std::make_unique<IdleWatch::Wait>(
      state.idle_watch, std::chrono::milliseconds(state.options.upload_idle_timeout_ms),
      [weak = call->weak_from_this()] {
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
    : state_(state),
      pass_(state.gate),
      context_(context),
      response_(response),
      record_(state, context, Rpc::kUploadMesh),
      uploads_(state.uploads) {
  SetDeadline(context, job_);
}

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
  if (!expected_id_.empty() && record_.bytes_in == 0) {
    if (std::shared_ptr<KeptMesh> mesh = state_.meshes.Touch(expected_id_)) {
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
    case v1::UploadMeshRequest::kPiece: return TakePiece(message);
    default: return absl::InvalidArgumentError("message: neither an upload nor a piece");
  }
}

absl::Status UploadMeshCall::TakeUpload(const v1::MeshUpload& upload) {
  if (std::exchange(begun_, true)) return absl::InvalidArgumentError("upload: only the first message may be one");
  absl::StatusOr<MeshFileType> type = ParseMeshType(upload.mesh_format(), upload.mesh_unit(), "upload.");
  if (!type.ok()) return type.status();
  type_ = *type;
  if (upload.mesh_id().empty()) return absl::OkStatus();
  expected_id_ = upload.mesh_id();
  return CheckMeshId(expected_id_, "upload.mesh_id");
}

absl::Status UploadMeshCall::TakePiece(v1::UploadMeshRequest& message) {
  std::string& piece = *message.mutable_piece();
  if (!begun_) return absl::InvalidArgumentError("upload: must come before the pieces");
  if (message.has_crc32c() && message.crc32c() != Crc32c(BytesOf(piece))) {
    return absl::DataLossError(
        absl::StrCat("the piece at byte ", record_.bytes_in, " of the mesh does not have its CRC-32C"));
  }
  if (piece.empty()) return absl::OkStatus();
  if (absl::Status s = TakeUploadBytes(state_, record_.bytes_in, piece.size(), uploads_); !s.ok()) return s;
  if (absl::Status s = record_.TakeBytes(piece.size()); !s.ok()) return s;
  AppendPiece(std::move(piece), pieces_);
  return absl::OkStatus();
}

void UploadMeshCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (job_.Check().ok()) job_.Cancel();
    Answer(job_.Check(), false);
    return;
  }
  if (!begun_) {
    Answer(absl::InvalidArgumentError("upload: the stream ended without one"), false);
    return;
  }
  auto task = std::make_shared<FileTask>(shared_from_this());
  task->traits.client = record_.client;
  task->traits.deadline = job_.deadline();
  MeshFacts facts;
  facts.format = type_.format;
  facts.file_bytes = record_.bytes_in;
  if (!pieces_.empty()) facts.compressed = FindCostlyParts(BytesOf(pieces_.front()), type_.format).compressed;
  task->traits.cost = PredictLoadCost(facts);
  {
    const std::lock_guard lock(mutex_);
    if (answered_) return;  // the idle watch ended the call first
    task_ = task;
  }
  if (absl::Status s = state_.scheduler.Submit(std::move(task)); !s.ok()) {
    Answer(s, false);
    return;
  }
  if (!job_.Check().ok()) OnCancel();  // it may have come before there was a ticket
}

void UploadMeshCall::Work() {
  try {
    if (absl::Status s = job_.Check(); !s.ok()) return Answer(s, false);
    std::vector<uint8_t> file = Join(pieces_, record_.bytes_in);
    const std::string id = MeshIdOf(file, type_.unit);
    if (!expected_id_.empty() && id != expected_id_) {
      return Answer(absl::DataLossError(absl::StrCat("the mesh's SHA-256 is ", id, ", not the mesh_id ", expected_id_)),
                    false);
    }
    if (std::shared_ptr<KeptMesh> mesh = state_.meshes.Claim(id, record_.client)) {
      return Answer(std::move(mesh), true);
    }
    const auto load_job = std::make_shared<JobContext>();  // continues while any call waits for the mesh
    const std::shared_ptr<MemoryBudget> memory = MakeRequestMemory(state_.working, *load_job);
    const auto done = [self = shared_from_this()](const Loads::Answer& mesh) { self->Keep(mesh); };
    const Loads::Seat seat = state_.loads.Join(absl::StrCat(id, "/", int(type_.format)), {.done = done, .news = {}});
    if (seat.first) state_.loads.WhenEmpty(seat.flight, [load_job] { load_job->Cancel(); });
    {
      const std::lock_guard lock(mutex_);
      seat_ = seat;
    }
    if (!job_.Check().ok()) LeaveFlight();
    if (seat.first) {
      state_.loads.Land(seat.flight, Load(std::move(file), id, *load_job));
    } else {
      uploads_.ShrinkTo(0);  // the other one has the same bytes
    }
  } catch (const std::bad_alloc&) {
    Answer(absl::ResourceExhaustedError("out of memory for the mesh file"), false);
  }
}

absl::StatusOr<std::shared_ptr<KeptMesh>> UploadMeshCall::Load(std::vector<uint8_t> file, const std::string& id,
                                                               const JobContext& job) {
  try {
    const uint64_t file_bytes = file.size();
    MeshFileType type = type_;
    if (type.format == MeshFormat::kAuto) type.format = DetectMeshFormat(job, file).value_or(type.format);
    absl::StatusOr<LoadedMesh> loaded =
        LoadMesh(std::move(file), {type, {}, state_.limits.load}, state_.limits.load_workers, job);
    if (!loaded.ok()) return loaded.status();
    return KeptMesh::Make(job, id, type, file_bytes, *std::move(loaded));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh");
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
}

void UploadMeshCall::Keep(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh) {
  Answer(mesh.ok() ? state_.meshes.Insert(*mesh, record_.client) : mesh, false);
}

void UploadMeshCall::Answer(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh, bool already_stored) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(answered_, true)) return;
    status_ = mesh.status();
    if (mesh.ok()) record_.facts = {{"mesh", (*mesh)->id()}, {"already_stored", uint64_t{already_stored}}};
  }
  if (mesh.ok()) {
    v1::UploadMeshResponse response;
    *response.mutable_mesh() = ToMessage(**mesh);
    response.set_already_stored(already_stored);
    WriteMessage(response, response_);
  }
  record_.Answered();
  Finish(ToGrpcStatus(mesh.status()));
}

void UploadMeshCall::GiveUp() {
  if (job_.Check().ok()) job_.Cancel();
  Answer(absl::AbortedError(
             absl::StrCat("the client sent too little of its mesh for ", state_.options.upload_idle_timeout_ms, " ms")),
         false);
}

void UploadMeshCall::LeaveFlight() {
  std::optional<Loads::Seat> seat;
  {
    const std::lock_guard lock(mutex_);
    seat = seat_;
  }
  if (!seat) return;
  state_.loads.Leave(*seat);
  Answer(job_.Check(), false);
}

void UploadMeshCall::OnCancel() {
  if (job_.Check().ok()) job_.Cancel();
  std::shared_ptr<FileTask> task;
  {
    const std::lock_guard lock(mutex_);
    task = task_;
  }
  if (task && state_.scheduler.Withdraw(*task)) {
    Answer(job_.Check(), false);
  } else {
    LeaveFlight();
  }
}

void UploadMeshCall::OnDone() {
  std::shared_ptr<UploadMeshCall> keep;
  {
    const std::lock_guard lock(mutex_);
    record_.Log(status_);
    task_.reset();  // it holds this call
    keep = std::move(self_);
  }
}

absl::Status GetMesh(ServiceState& state, const v1::GetMeshRequest& request, v1::GetMeshResponse& response) {
  if (absl::Status s = CheckMeshId(request.mesh_id(), "mesh_id"); !s.ok()) return s;
  const absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Get(request.mesh_id());
  if (!mesh.ok()) return mesh.status();
  *response.mutable_mesh() = ToMessage(**mesh);
  return absl::OkStatus();
}

absl::Status DeleteMesh(ServiceState& state, const CallRecord& caller, const v1::DeleteMeshRequest& request,
                        v1::DeleteMeshResponse& response) {
  if (absl::Status s = CheckMeshId(request.mesh_id(), "mesh_id"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = caller.role() == Role::kAdmin
                                                       ? state.meshes.Delete(request.mesh_id())
                                                       : state.meshes.Release(request.mesh_id(), caller.client);
  if (!mesh.ok()) return mesh.status();
  if (*mesh == nullptr) {
    response.set_kept_for_others(true);
    return absl::OkStatus();
  }
  response.set_freed_bytes((*mesh)->memory_bytes());
  // Freeing gigabytes takes long: not on gRPC's thread, unless all loaders are overloaded.
  state.scheduler.Submit(std::make_shared<FreeTask>(*std::move(mesh))).IgnoreError();
  return absl::OkStatus();
}

}  // namespace voxelpipe
