#include "client.h"

#include "absl/strings/str_cat.h"
#include "call_watch.h"
#include "channel.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "many_call.h"
#include "mesh_calls.h"
#include "raw_calls.h"
#include "reply/checked_lists.h"
#include "retry.h"
#include "voxelize_call.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/request.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

// For calls that run no job on the server.
constexpr std::chrono::seconds kQuickCall{10};

// In messages an empty id means that the file follows.
absl::Status NoMeshId() {
  return absl::InvalidArgumentError("mesh_id: is empty");
}

using OnPlan = std::function<void(const Plan&)>;

// Passes a result on, and tells if the sink has received any of it.
class WatchedSink final : public ResultSink {
 public:
  explicit WatchedSink(ResultSink& sink) : sink_(sink) {}
  bool used() const { return used_; }

  absl::Status Begin(const ResultHeader& header) override {
    used_ = true;
    return sink_.Begin(header);
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override { return sink_.Write(array, bytes); }

 private:
  ResultSink& sink_;
  bool used_ = false;
};

}  // namespace

struct Client::Impl {
  std::string target;
  ConnectOptions options;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<const RawCalls> raw;  // never null after Connect
  std::unique_ptr<v1::VoxelizationService::Stub> service;
  std::unique_ptr<grpc::health::v1::Health::Stub> health;

  // Makes a short unary call.
  template <typename Service, typename Method, typename Request, typename Response>
  absl::Status Quick(Service& stub, Method method, const Request& request, Response& response,
                     std::chrono::milliseconds timeout = kQuickCall) const {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout);
    const JobContext job;
    return CallStatus((stub.*method)(&context, request, &response), job, target);
  }

  absl::StatusOr<RemoteResult> Voxelize(const MeshSource& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const OnPlan& on_plan) {
    return CallWithRetries(options.retries, job, [&] {
      return CallVoxelize(*raw, target, options.max_result_bytes, options.settings, mesh, request, job, on_plan);
    });
  }

  absl::StatusOr<RemoteRun> VoxelizeTo(const MeshSource& mesh, const VoxelizeRequest& request, const JobContext& job,
                                       ResultSink& sink, const OnPlan& on_plan) {
    WatchedSink watched(sink);
    const auto attempt = [&]() -> absl::StatusOr<RemoteRun> {
      CheckedLists checked(watched);
      absl::StatusOr<RemoteRun> run = CallVoxelizeTo(*raw, target, options.max_result_bytes, options.settings, mesh,
                                                     request, job, checked, on_plan);
      if (!run.ok()) return run;
      if (absl::Status s = checked.Finish(); !s.ok()) return s;
      return run;
    };
    return CallWithRetries(options.retries, job, attempt, [&] { return !watched.used(); });
  }

  absl::StatusOr<Estimated> Estimate(const v1::EstimateVoxelizationRequest& request, const JobContext& job) const {
    return CallWithRetries(options.retries, job, [&] { return EstimateOnce(request, job); });
  }

  absl::StatusOr<Estimated> EstimateOnce(const v1::EstimateVoxelizationRequest& request, const JobContext& job) const {
    if (absl::Status status = job.Check(); !status.ok()) return status;
    grpc::ClientContext context;
    const CallWatch watch(context, job);
    v1::EstimateVoxelizationResponse response;
    const grpc::Status status = service->EstimateVoxelization(&context, request, &response);
    if (!status.ok()) return CallStatus(status, job, target);
    absl::StatusOr<Plan> plan = FromMessage(response.plan());
    if (!plan.ok()) return plan.status();
    return Estimated{*std::move(plan), FromMessage(response.mesh())};
  }
};

Client::Client(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Client::~Client() = default;

const std::string& Client::target() const {
  return impl_->target;
}

absl::StatusOr<std::unique_ptr<Client>> Client::Connect(const std::string& target, const ConnectOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->target = target;
  impl->options = options;
  absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = OpenChannel(target, options);
  if (!channel.ok()) return channel.status();
  impl->channel = *std::move(channel);
  impl->service = v1::VoxelizationService::NewStub(impl->channel);
  impl->raw = std::make_unique<RawCalls>(impl->channel);
  impl->health = grpc::health::v1::Health::NewStub(impl->channel);
  return std::unique_ptr<Client>(new Client(std::move(impl)));
}

absl::StatusOr<RemoteResult> Client::Voxelize(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                              const VoxelizeRequest& request, const JobContext& job,
                                              const std::function<void(const Plan&)>& on_plan) {
  return impl_->Voxelize(MeshSource::File(mesh_bytes, type), request, job, on_plan);
}

absl::StatusOr<RemoteRun> Client::VoxelizeTo(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                             const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                             const std::function<void(const Plan&)>& on_plan) {
  return impl_->VoxelizeTo(MeshSource::File(mesh_bytes, type), request, job, sink, on_plan);
}

std::unique_ptr<ManyStream> Client::OpenMany(const JobContext& job, size_t window) {
  return OpenManyStream(*impl_->service, impl_->target, impl_->options, job, window);
}

absl::StatusOr<StoredMesh> Client::UploadMesh(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                              const JobContext& job) {
  return CallWithRetries(impl_->options.retries, job,
                         [&] { return CallUploadMesh(*impl_->raw, impl_->target, mesh_bytes, type, job); });
}

absl::StatusOr<RemoteResult> Client::VoxelizeStored(const std::string& mesh_id, const VoxelizeRequest& request,
                                                    const JobContext& job, std::span<const float> new_positions,
                                                    const std::function<void(const Plan&)>& on_plan) {
  if (mesh_id.empty()) return NoMeshId();
  return impl_->Voxelize(MeshSource::Stored(mesh_id, new_positions), request, job, on_plan);
}

absl::StatusOr<RemoteRun> Client::VoxelizeStoredTo(const std::string& mesh_id, const VoxelizeRequest& request,
                                                   const JobContext& job, ResultSink& sink,
                                                   std::span<const float> new_positions,
                                                   const std::function<void(const Plan&)>& on_plan) {
  if (mesh_id.empty()) return NoMeshId();
  return impl_->VoxelizeTo(MeshSource::Stored(mesh_id, new_positions), request, job, sink, on_plan);
}

absl::StatusOr<StoredMesh> Client::GetMesh(const std::string& mesh_id) {
  v1::GetMeshRequest request;
  request.set_mesh_id(mesh_id);
  v1::GetMeshResponse response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::GetMesh, request, response);
  if (!status.ok()) return status;
  return FromMessage(response.mesh());
}

absl::StatusOr<uint64_t> Client::DeleteMesh(const std::string& mesh_id) {
  v1::DeleteMeshRequest request;
  request.set_mesh_id(mesh_id);
  v1::DeleteMeshResponse response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::DeleteMesh, request, response);
  if (!status.ok()) return status;
  return response.freed_bytes();
}

absl::StatusOr<Client::Estimated> Client::EstimateStored(const std::string& mesh_id, const VoxelizeRequest& request,
                                                         const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  *message.mutable_config() = MakeConfig(request);
  message.set_mesh_id(mesh_id);
  return impl_->Estimate(message, job);
}

absl::StatusOr<Client::Estimated> Client::Estimate(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                                   const VoxelizeRequest& request, const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  *message.mutable_config() = MakeConfig(request, type);
  message.set_mesh_bytes(mesh_bytes.data(), mesh_bytes.size());
  return impl_->Estimate(message, job);
}

absl::StatusOr<Plan> Client::Estimate(uint64_t triangles, uint64_t vertices, const Box3d& shaded_box,
                                      const VoxelizeRequest& request, const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  *message.mutable_config() = MakeConfig(request);
  v1::MeshSummary* mesh = message.mutable_summary();
  mesh->set_triangles(triangles);
  mesh->set_vertices(vertices);
  if (!shaded_box.empty) {
    const auto write = [](const Vec3d& from, v1::Vec3* to) {
      to->set_x(from.x);
      to->set_y(from.y);
      to->set_z(from.z);
    };
    write(shaded_box.min, mesh->mutable_min());
    write(shaded_box.max, mesh->mutable_max());
  }
  absl::StatusOr<Estimated> estimated = impl_->Estimate(message, job);
  if (!estimated.ok()) return estimated.status();
  return std::move(estimated->plan);
}

absl::StatusOr<std::vector<ShaderInfo>> Client::ListShaders() {
  v1::ListShadersResponse response;
  absl::Status status =
      impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::ListShaders, v1::ListShadersRequest(), response);
  if (!status.ok()) return status;
  std::vector<ShaderInfo> shaders;
  for (const v1::ShaderInfo& shader : response.shaders()) shaders.push_back(FromMessage(shader));
  return shaders;
}

absl::StatusOr<ServerDescription> Client::ServerInfo() {
  v1::GetServerInfoResponse response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::GetServerInfo,
                                     v1::GetServerInfoRequest(), response);
  if (!status.ok()) return status;
  ServerDescription server;
  server.version = response.version();
  for (const v1::BackendInfo& backend : response.backends())
    server.backends.push_back({backend.name(), backend.simd()});
  for (const v1::Device& device : response.devices()) {
    server.devices.push_back({device.name(), device.backend(), device.model(), device.memory_bytes(), device.workers(),
                              device.state() != v1::DEVICE_STATE_QUARANTINED, device.reason()});
  }
  server.threads = response.threads();
  server.workers = response.limits().workers();
  server.max_queue = response.limits().max_queue();
  server.max_file_bytes = response.limits().max_file_bytes();
  server.max_result_bytes = response.limits().max_result_bytes();
  server.max_working_bytes = response.limits().max_working_bytes();
  server.max_triangles = response.limits().max_triangles();
  server.max_mesh_store_bytes = response.limits().max_mesh_store_bytes();
  server.max_message_bytes = response.limits().max_message_bytes();
  return server;
}

absl::Status Client::CheckHealth(std::chrono::milliseconds timeout) {
  grpc::health::v1::HealthCheckResponse response;
  absl::Status status = impl_->Quick(*impl_->health, &grpc::health::v1::Health::Stub::Check,
                                     grpc::health::v1::HealthCheckRequest(), response, timeout);
  if (!status.ok()) return status;
  if (response.status() == grpc::health::v1::HealthCheckResponse::SERVING) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(impl_->target, ": the server takes no requests"));
}

}  // namespace voxelpipe
