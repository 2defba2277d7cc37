#include "calls/mesh_upload.h"

#include <exception>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "isolate/loading.h"
#include "jobs/request_memory.h"
#include "load/costly_parts.h"
#include "load/load_mesh.h"
#include "reply/raw_message.h"
#include "schedule/cost.h"
#include "wire/mesh_name.h"
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

}  // namespace

class MeshUpload::FileTask final : public Task {
 public:
  explicit FileTask(std::shared_ptr<MeshUpload> call) : call_(std::move(call)) {}
  bool loaded() const override { return false; }
  bool Load() override {
    call_->Work();
    return false;
  }
  void Refuse(absl::Status why) override { call_->Answer(why, false); }

 private:
  const std::shared_ptr<MeshUpload> call_;
};

v1::Mesh ToMessage(KeptMesh& mesh) {
  v1::Mesh message;
  message.set_name(mesh.name());
  message.set_format(ToMessage(mesh.type().format));
  message.set_unit(ToMessage(mesh.type().unit));
  message.set_file_bytes(int64_t(mesh.file_bytes()));
  message.set_memory_bytes(int64_t(mesh.memory_bytes()));
  const KeptMesh::Facts facts = mesh.Report();
  *message.mutable_report() = ToMessage(facts.report, facts.examined);
  WriteWarnings(facts.warnings, message);
  message.set_uses(int64_t(mesh.uses()));
  return message;
}

MeshUpload::MeshUpload(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc, grpc::ByteBuffer& response)
    : state_(state),
      pass_(state.gate),
      context_(context),
      record_(state, context, rpc),
      response_(response),
      uploads_(state.uploads) {
  SetDeadline(context, job_);
}

absl::Status MeshUpload::TakePiece(std::string piece, std::optional<uint32_t> crc32c) {
  if (absl::Status s = CheckMeshCrc(piece, crc32c, record_.bytes_in); !s.ok()) return s;
  if (piece.empty()) return absl::OkStatus();
  if (absl::Status s = TakeUploadBytes(state_, record_.bytes_in, piece.size(), uploads_); !s.ok()) return s;
  if (absl::Status s = record_.TakeBytes(piece.size()); !s.ok()) return s;
  AppendPiece(std::move(piece), pieces_);
  return absl::OkStatus();
}

void MeshUpload::SubmitFile() {
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
  if (!job_.Check().ok()) Cancelled();  // it may have come before there was a ticket
}

void MeshUpload::Work() {
  try {
    if (absl::Status s = job_.Check(); !s.ok()) return Answer(s, false);
    std::vector<uint8_t> file = Join(pieces_, record_.bytes_in);
    const std::string name = MeshNameOf(file, type_);
    if (!expected_name_.empty() && name != expected_name_) {
      return Answer(absl::DataLossError(absl::StrCat("the mesh is ", name, ", not ", expected_name_)), false);
    }
    if (std::shared_ptr<KeptMesh> mesh = state_.meshes.Claim(name, record_.client)) {
      return Answer(std::move(mesh), true);
    }
    const auto load_job = std::make_shared<JobContext>();  // continues while any call waits for the mesh
    const std::shared_ptr<MemoryBudget> memory = MakeRequestMemory(state_.working, *load_job);
    const auto done = [self = shared_from_this()](const Loads::Answer& mesh) { self->Keep(mesh); };
    const Loads::Seat seat = state_.loads.Join(name, {.done = done, .news = {}});
    if (seat.first) state_.loads.WhenEmpty(seat.flight, [load_job] { load_job->Cancel(); });
    {
      const std::lock_guard lock(mutex_);
      seat_ = seat;
    }
    if (!job_.Check().ok()) LeaveFlight();
    if (seat.first) {
      state_.loads.Land(seat.flight, Load(std::move(file), name, *load_job));
    } else {
      uploads_.ShrinkTo(0);  // the other one has the same bytes
    }
  } catch (const std::bad_alloc&) {
    Answer(absl::ResourceExhaustedError("out of memory for the mesh file"), false);
  }
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshUpload::Load(std::vector<uint8_t> file, const std::string& name,
                                                           const JobContext& job) {
  try {
    const uint64_t file_bytes = file.size();
    MeshFileType type = type_;
    if (type.format == MeshFormat::kAuto) type.format = DetectMeshFormat(job, file).value_or(type.format);
    absl::StatusOr<LoadedMesh> loaded =
        LoadMesh(std::move(file), {type, {}, state_.limits.load}, state_.limits.load_workers, job);
    if (!loaded.ok()) return loaded.status();
    return KeptMesh::Make(job, name, type, file_bytes, *std::move(loaded));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh");
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
}

void MeshUpload::Keep(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh) {
  Answer(mesh.ok() ? state_.meshes.Insert(*mesh, record_.client) : mesh, false);
}

void MeshUpload::Answer(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh, bool already_stored) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(answered_, true)) return;
    status_ = mesh.status();
    if (mesh.ok()) record_.facts = {{"mesh", (*mesh)->name()}, {"already_stored", uint64_t{already_stored}}};
  }
  if (mesh.ok()) {
    v1::Mesh response = ToMessage(**mesh);
    response.set_already_stored(already_stored);
    WriteMessage(response, response_);
  }
  record_.Answered();
  FinishCall(ToGrpcStatus(mesh.status()));
}

void MeshUpload::LeaveFlight() {
  std::optional<Loads::Seat> seat;
  {
    const std::lock_guard lock(mutex_);
    seat = seat_;
  }
  if (!seat) return;
  state_.loads.Leave(*seat);
  Answer(job_.Check(), false);
}

void MeshUpload::Cancelled() {
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

void MeshUpload::Ended() {
  std::shared_ptr<MeshUpload> keep;
  {
    const std::lock_guard lock(mutex_);
    record_.Log(status_);
    task_.reset();  // it holds this call
    keep = std::move(self_);
  }
}

}  // namespace voxelpipe
