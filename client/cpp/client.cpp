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
#include "wire/count.h"
#include "wire/request.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

// For calls that run no job on the server.
constexpr std::chrono::seconds kQuickCall{10};
constexpr int kMeshesOfAPage = 1000;  // the server's maximum

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
                     std::chrono::system_clock::time_point deadline = std::chrono::system_clock::now() +
                                                                      kQuickCall) const {
    grpc::ClientContext context;
    context.set_deadline(deadline);
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

  // `message`: with its mesh.
  absl::StatusOr<Estimated> Estimate(v1::EstimateVoxelizationRequest& message, const VoxelizeRequest& request,
                                     const JobContext& job) const {
    if (absl::Status status = CheckSendable(request); !status.ok()) return status;
    WriteTo(request, *message.mutable_spec());
    *message.mutable_execution() = MakeExecution(request);
    return CallWithRetries(options.retries, job, [&] { return EstimateOnce(message, job); });
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
    return Estimated{*std::move(plan), FromMessage(response.report())};
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

absl::StatusOr<RemoteResult> Client::VoxelizeStored(const std::string& mesh_name, const VoxelizeRequest& request,
                                                    const JobContext& job, std::span<const float> new_positions,
                                                    const std::function<void(const Plan&)>& on_plan) {
  return impl_->Voxelize(MeshSource::Stored(mesh_name, new_positions), request, job, on_plan);
}

absl::StatusOr<RemoteRun> Client::VoxelizeStoredTo(const std::string& mesh_name, const VoxelizeRequest& request,
                                                   const JobContext& job, ResultSink& sink,
                                                   std::span<const float> new_positions,
                                                   const std::function<void(const Plan&)>& on_plan) {
  return impl_->VoxelizeTo(MeshSource::Stored(mesh_name, new_positions), request, job, sink, on_plan);
}

absl::StatusOr<RemoteResult> Client::VoxelizePlaced(std::span<const PlacedStored> meshes,
                                                    const VoxelizeRequest& request, const JobContext& job,
                                                    const std::function<void(const Plan&)>& on_plan) {
  return impl_->Voxelize(MeshSource::Placed(meshes), request, job, on_plan);
}

absl::StatusOr<RemoteRun> Client::VoxelizePlacedTo(std::span<const PlacedStored> meshes, const VoxelizeRequest& request,
                                                   const JobContext& job, ResultSink& sink,
                                                   const std::function<void(const Plan&)>& on_plan) {
  return impl_->VoxelizeTo(MeshSource::Placed(meshes), request, job, sink, on_plan);
}

absl::StatusOr<StoredMesh> Client::GetMesh(const std::string& mesh_name) {
  v1::GetMeshRequest request;
  request.set_name(mesh_name);
  v1::Mesh response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::GetMesh, request, response);
  if (!status.ok()) return status;
  return FromMessage(response);
}

absl::StatusOr<std::vector<StoredMesh>> Client::ListMeshes() {
  std::vector<StoredMesh> meshes;
  v1::ListMeshesRequest request;
  request.set_page_size(kMeshesOfAPage);
  // Of all pages together, which a server may give without end.
  const auto deadline = std::chrono::system_clock::now() + kQuickCall;
  do {
    v1::ListMeshesResponse page;
    absl::Status status =
        impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::ListMeshes, request, page, deadline);
    if (!status.ok()) return status;
    for (const v1::Mesh& message : page.meshes()) {
      absl::StatusOr<StoredMesh> mesh = FromMessage(message);
      if (!mesh.ok()) return mesh.status();
      meshes.push_back(*std::move(mesh));
    }
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty());
  return meshes;
}

absl::StatusOr<uint64_t> Client::ReleaseMesh(const std::string& mesh_name) {
  v1::ReleaseMeshRequest request;
  request.set_name(mesh_name);
  v1::ReleaseMeshResponse response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::ReleaseMesh, request, response);
  if (!status.ok()) return status;
  return CountOf(response.freed_bytes());
}

absl::StatusOr<uint64_t> Client::DeleteMesh(const std::string& mesh_name) {
  v1::DeleteMeshRequest request;
  request.set_name(mesh_name);
  v1::DeleteMeshResponse response;
  absl::Status status = impl_->Quick(*impl_->service, &v1::VoxelizationService::Stub::DeleteMesh, request, response);
  if (!status.ok()) return status;
  return CountOf(response.freed_bytes());
}

absl::StatusOr<Client::Estimated> Client::EstimateStored(const std::string& mesh_name, const VoxelizeRequest& request,
                                                         const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  WriteWithBytes(MeshSource::Stored(mesh_name, {}), *message.mutable_mesh());
  return impl_->Estimate(message, request, job);
}

absl::StatusOr<Client::Estimated> Client::EstimatePlaced(std::span<const PlacedStored> meshes,
                                                         const VoxelizeRequest& request, const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  WriteWithBytes(MeshSource::Placed(meshes), *message.mutable_mesh());
  return impl_->Estimate(message, request, job);
}

absl::StatusOr<Client::Estimated> Client::Estimate(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                                   const VoxelizeRequest& request, const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  WriteWithBytes(MeshSource::File(mesh_bytes, type), *message.mutable_mesh());
  return impl_->Estimate(message, request, job);
}

absl::StatusOr<Plan> Client::Estimate(uint64_t triangles, uint64_t vertices, const Box3d& shaded_box,
                                      const VoxelizeRequest& request, const JobContext& job) {
  v1::EstimateVoxelizationRequest message;
  v1::MeshSummary* mesh = message.mutable_summary();
  mesh->set_triangles(int64_t(triangles));
  mesh->set_vertices(int64_t(vertices));
  if (!shaded_box.empty) {
    const auto write = [](const Vec3d& from, v1::Vec3* to) {
      to->set_x(from.x);
      to->set_y(from.y);
      to->set_z(from.z);
    };
    write(shaded_box.min, mesh->mutable_min());
    write(shaded_box.max, mesh->mutable_max());
  }
  absl::StatusOr<Estimated> estimated = impl_->Estimate(message, request, job);
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
  for (const v1::BackendInfo& backend : response.backends()) {
    const std::string name(NameOf(backend.backend()));
    // A GPU has no instruction set of row kernels.
    const bool gpu = backend.backend() == v1::BACKEND_CUDA;
    server.backends.push_back({name, gpu ? name : std::string(NameOf(backend.simd()))});
  }
  for (const v1::Device& device : response.devices()) {
    server.devices.push_back({device.name(), std::string(NameOf(device.backend())), device.model(),
                              CountOf(device.memory_bytes()), uint32_t(CountOf(device.workers())),
                              device.state() != v1::DEVICE_STATE_QUARANTINED, device.reason()});
  }
  const v1::ServerLimits& limits = response.limits();
  server.threads = uint32_t(CountOf(response.threads()));
  server.workers = uint32_t(CountOf(limits.load_workers()));
  server.max_queue = uint32_t(CountOf(limits.max_queue()));
  server.max_file_bytes = CountOf(limits.max_file_bytes());
  server.max_result_bytes = CountOf(limits.max_result_bytes());
  server.max_working_bytes = CountOf(limits.max_working_bytes());
  server.max_triangles = CountOf(limits.max_triangles());
  server.max_mesh_store_bytes = CountOf(limits.max_mesh_store_bytes());
  server.max_message_bytes = CountOf(limits.max_message_bytes());
  server.batch_jobs = uint32_t(CountOf(limits.batch_jobs()));
  return server;
}

absl::Status Client::CheckHealth(std::chrono::milliseconds timeout) {
  grpc::health::v1::HealthCheckResponse response;
  absl::Status status =
      impl_->Quick(*impl_->health, &grpc::health::v1::Health::Stub::Check, grpc::health::v1::HealthCheckRequest(),
                   response, std::chrono::system_clock::now() + timeout);
  if (!status.ok()) return status;
  if (response.status() == grpc::health::v1::HealthCheckResponse::SERVING) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(impl_->target, ": the server takes no requests"));
}

}  // namespace voxelpipe
