#include "calls/estimate_call.h"

#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "calls/call_setup.h"
#include "calls/job_setup.h"
#include "jobs/prepare_kept.h"
#include "jobs/request_memory.h"
#include "load/costly_parts.h"
#include "load/decode/image.h"
#include "pipeline/planner.h"
#include "pipeline/warnings.h"
#include "reply/raw_message.h"
#include "schedule/cost.h"
#include "wire/count.h"
#include "wire/mesh_contents.h"
#include "wire/mesh_name.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

std::optional<uint32_t> Crc32cOf(const v1::MeshBytes& mesh) {
  return mesh.has_crc32c() ? std::optional(mesh.crc32c()) : std::nullopt;
}

absl::StatusOr<Box3d> ReadBox(const v1::MeshSummary& summary) {
  const Vec3d min{summary.min().x(), summary.min().y(), summary.min().z()};
  const Vec3d max{summary.max().x(), summary.max().y(), summary.max().z()};
  for (int a = 0; a < 3; ++a) {
    if (!std::isfinite(min[a])) return absl::InvalidArgumentError("summary.min: must be finite");
    if (!std::isfinite(max[a])) return absl::InvalidArgumentError("summary.max: must be finite");
    if (max[a] < min[a]) return absl::InvalidArgumentError("summary.max: must not be below summary.min");
  }
  return Box3d{min, max, summary.triangles() <= 0};
}

}  // namespace

class EstimateCall::MeshTask final : public Task {
 public:
  MeshTask(std::shared_ptr<EstimateCall> call, ParsedConfig config)
      : call_(std::move(call)), config_(std::move(config)) {}

  bool loaded() const override { return false; }
  void Weigh() override { traits.cost = call_->Cost(config_); }
  bool Load() override {
    call_->End(call_->FromMesh(config_));
    return false;
  }
  void Refuse(absl::Status why) override { call_->End(why); }

 private:
  const std::shared_ptr<EstimateCall> call_;
  const ParsedConfig config_;
};

EstimateCall* EstimateCall::Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& request,
                                   grpc::ByteBuffer& response) {
  std::shared_ptr<EstimateCall> call(new EstimateCall(state, context, response));
  call->self_ = call;
  call->Start(request);
  return call.get();
}

EstimateCall::EstimateCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response)
    : state_(state),
      pass_(state.gate),
      response_bytes_(response),
      record_(state, context, Rpc::kEstimateVoxelization),
      uploads_(state.uploads) {
  SetDeadline(context, job_);
  memory_ = MakeRequestMemory(state.working, job_);
}

void EstimateCall::Start(grpc::ByteBuffer& request) {
  absl::Status begun = MayBegin(pass_, record_.admission());
  if (begun.ok()) begun = ReadMessage(request, request_);
  const uint64_t mesh_bytes = data().size();
  if (begun.ok()) begun = TakeUploadBytes(state_, 0, mesh_bytes, uploads_);
  if (begun.ok()) begun = record_.TakeBytes(mesh_bytes);
  if (!begun.ok()) {
    End(begun);
    return;
  }
  absl::StatusOr<ParsedConfig> config = ParseMessage();
  const BackendChoice asked = config.ok() ? config->request.backend : BackendChoice::kAuto;
  absl::Status status = config.ok() ? PrepareRequest(state_, config->request) : config.status();
  if (status.ok()) {
    ChooseKinds(state_, asked, *config, kinds_);
    status = state_.pool.CheckServed(kinds_);
  }
  if (status.ok()) status = TakeListBytes(*config, uploads_);
  if (status.ok()) status = FindKeptMeshes(*config);
  if (!status.ok() || !request_.has_mesh()) {
    End(status.ok() ? FromSummary(*config) : status);
    return;
  }
  // While the job waits, only its mesh has been counted.
  request_.clear_spec();
  request_.clear_execution();
  if (config->placed) request_.clear_mesh();  // the config has it
  request_.DiscardUnknownFields();
  auto task = std::make_shared<MeshTask>(self_, *std::move(config));
  task->traits.client = record_.client;
  task->traits.deadline = job_.deadline();
  {
    const std::lock_guard lock(mutex_);
    task_ = task;
  }
  if (absl::Status s = state_.scheduler.Submit(std::move(task)); !s.ok()) {
    End(s);
    return;
  }
  if (!job_.Check().ok()) OnCancel();
}

absl::StatusOr<ParsedConfig> EstimateCall::ParseMessage() const {
  absl::StatusOr<ParsedConfig> config = ParseRequest(request_.spec(), request_.execution());
  if (!config.ok() || !request_.has_mesh()) return config;
  if (absl::Status s = ParseMesh(request_.mesh(), *config); !s.ok()) return s;
  if (config->new_positions) {
    return absl::InvalidArgumentError("mesh.stored.positions: an estimate takes the mesh as it is stored");
  }
  if (absl::Status s = CheckMeshCrc(data(), Crc32cOf(request_.mesh().bytes()), 0); !s.ok()) return s;
  return config;
}

absl::Status EstimateCall::FindKeptMeshes(const ParsedConfig& config) {
  if (config.placed) {
    absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> meshes = state_.meshes.GetAll(*config.placed);
    if (meshes.ok()) kept_ = *std::move(meshes);
    return meshes.status();
  }
  if (config.mesh_name.empty()) return absl::OkStatus();
  if (absl::Status s = CheckMeshName(config.mesh_name, "mesh.stored.name"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state_.meshes.Get(config.mesh_name);
  if (mesh.ok()) kept_ = {*std::move(mesh)};
  return mesh.status();
}

JobCost EstimateCall::Cost(const ParsedConfig& config) const {
  MeshFacts facts;
  facts.format = config.mesh_type.format;
  if (!kept_.empty()) {
    facts.triangles = TrianglesOf(kept_);
  } else {
    const std::string& bytes = data();
    facts.file_bytes = bytes.size();
    facts.compressed =
        FindCostlyParts({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}, facts.format).compressed;
  }
  JobCost cost = PredictEstimateCost(config.request, facts);
  const bool made = config.placed || (!kept_.empty() && !config.request.parts.exclude.empty());
  if (made) cost.load_ms += PredictPlaceMs(kept_.size(), *facts.triangles);
  return cost;
}

absl::Status EstimateCall::FromSummary(const ParsedConfig& config) {
  if (!request_.has_summary()) {
    return absl::InvalidArgumentError("mesh: neither a mesh nor a summary");
  }
  const absl::StatusOr<Box3d> box = ReadBox(request_.summary());
  if (!box.ok()) return box.status();
  const absl::StatusOr<const Backend*> device = state_.pool.FindDevice(kinds_);
  if (!device.ok()) return device.status();
  const absl::StatusOr<Plan> plan = PlanVoxelization(
      **device, config.request, CountOf(request_.summary().triangles()), CountOf(request_.summary().vertices()),
      MeshExtent{.box = *box, .held_bytes = 0, .sums = {}}, state_.limits.plan, Delivery::kStream);
  if (!plan.ok()) return plan.status();
  *response_.mutable_plan() = ToMessage(*plan);
  return absl::OkStatus();
}

absl::Status EstimateCall::FromMesh(const ParsedConfig& config) {
  const std::string& bytes = data();
  const auto mesh = kept_.empty()
                        ? PrepareMesh(std::vector<uint8_t>(bytes.begin(), bytes.end()), config, state_.limits, job_)
                        : PrepareKept(state_.meshes, kept_, {}, config, state_.limits, job_);
  if (!mesh.ok()) return mesh.status();
  const absl::StatusOr<const Backend*> device = state_.pool.FindDevice(kinds_);
  if (!device.ok()) return device.status();
  const absl::StatusOr<Estimate> estimate = EstimateJob(**device, **mesh, config, state_.limits, job_);
  if (!estimate.ok()) return estimate.status();
  *response_.mutable_plan() = ToMessage(estimate->plan);
  *response_.mutable_report() = ToMessage(estimate->report, (*mesh)->examined);
  if (kept_.empty()) CheckImages(*(*mesh)->mesh);  // not shared with other calls
  const bool one = config.placed == nullptr && !kept_.empty() && config.request.parts.exclude.empty();
  WriteWarnings(one ? kept_.front()->Report().warnings : AllWarningsOf(*(*mesh)->mesh), response_);
  if (kept_.empty()) *response_.mutable_contents() = ToMessage((*mesh)->contents, (*mesh)->stages);
  return absl::OkStatus();
}

void EstimateCall::End(const absl::Status& status) {
  {
    const std::lock_guard lock(mutex_);
    status_ = status;
  }
  if (status.ok()) WriteMessage(response_, response_bytes_);
  record_.Answered();
  Finish(ToGrpcStatus(status));
}

void EstimateCall::OnCancel() {
  if (job_.Check().ok()) job_.Cancel();
  std::shared_ptr<MeshTask> task;
  {
    const std::lock_guard lock(mutex_);
    task = task_;
  }
  // A running job ends soon by itself, and only then may gRPC free request and response.
  if (task && state_.scheduler.Withdraw(*task)) End(job_.Check());
}

void EstimateCall::OnDone() {
  std::shared_ptr<EstimateCall> keep;
  {
    const std::lock_guard lock(mutex_);
    record_.Log(status_);
    task_.reset();  // breaks the cycle: it holds this call
    keep = std::move(self_);
  }
}

}  // namespace voxelpipe
