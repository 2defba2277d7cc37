#include "observe/health_service.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "wire/status.h"

namespace voxelpipe {
namespace {

using grpc::health::v1::HealthCheckRequest;
using grpc::health::v1::HealthCheckResponse;

constexpr char kService[] = "voxelpipe.v1.VoxelizationService";
constexpr char kDevice[] = "device/";

}  // namespace

// One Watch call. Writes one status at a time; of several changes in between only the last is sent.
class HealthService::Watcher final : public grpc::ServerWriteReactor<HealthCheckResponse> {
 public:
  static std::shared_ptr<Watcher> Create() {
    auto watcher = std::make_shared<Watcher>();
    watcher->self_ = watcher;
    return watcher;
  }

  void Tell(ServingStatus status) {
    {
      const std::lock_guard lock(mutex_);
      next_ = status;
    }
    Pump();
  }

  void End(grpc::Status status) {
    {
      const std::lock_guard lock(mutex_);
      if (!end_) end_ = std::move(status);
    }
    Pump();
  }

  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      writing_ = false;
      if (!ok && !end_) end_ = grpc::Status::CANCELLED;
    }
    Pump();
  }
  void OnCancel() override { End(grpc::Status::CANCELLED); }
  void OnDone() override { const std::shared_ptr<Watcher> keep = std::move(self_); }

 private:
  void Pump() {
    bool write = false;
    grpc::Status status;
    {
      const std::lock_guard lock(mutex_);
      if (writing_ || finished_) return;
      if (end_) {
        finished_ = true;
        status = *end_;
      } else if (next_ && next_ != told_) {
        told_ = next_;
        response_.set_status(*told_);
        write = writing_ = true;
      } else {
        return;
      }
    }
    if (write) {
      StartWrite(&response_);
    } else {
      Finish(status);
    }
  }

  std::shared_ptr<Watcher> self_;  // until OnDone
  std::mutex mutex_;
  HealthCheckResponse response_;  // in flight while writing_
  std::optional<ServingStatus> next_, told_;
  std::optional<grpc::Status> end_;
  bool writing_ = false, finished_ = false;
};

HealthService::HealthService(Door door) : door_(std::move(door)) {}
HealthService::~HealthService() = default;

std::optional<HealthService::ServingStatus> HealthService::StatusOf(const std::string& name) const {
  bool serving = serving_;
  if (!name.empty() && name != kService) {
    const auto device = devices_.find(name);
    if (device == devices_.end()) return std::nullopt;
    serving = serving && device->second;
  }
  return serving ? HealthCheckResponse::SERVING : HealthCheckResponse::NOT_SERVING;
}

bool HealthService::serving() const {
  const std::lock_guard lock(mutex_);
  return serving_;
}

void HealthService::SetServing(bool serving) {
  {
    const std::lock_guard lock(mutex_);
    serving_ = serving;
  }
  TellAll();
}

void HealthService::SetDevice(const std::string& device, bool serving) {
  {
    const std::lock_guard lock(mutex_);
    devices_[kDevice + device] = serving;
  }
  TellAll();
}

void HealthService::TellAll() {
  std::vector<std::pair<std::string, std::shared_ptr<Watcher>>> alive;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, watcher] : watchers_) {
      if (auto one = watcher.lock()) alive.emplace_back(name, std::move(one));
    }
  }
  for (const auto& [name, watcher] : alive) {
    // Read again for each, so that of two changes at the same time the later one is sent last.
    const std::lock_guard lock(telling_mutex_);
    std::optional<ServingStatus> status;
    {
      const std::lock_guard now(mutex_);
      status = StatusOf(name);
    }
    watcher->Tell(status.value_or(HealthCheckResponse::SERVICE_UNKNOWN));
  }
}

void HealthService::EndWatches() {
  std::vector<std::pair<std::string, std::weak_ptr<Watcher>>> watchers;
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    watchers.swap(watchers_);
  }
  for (const auto& [name, watcher] : watchers) {
    if (const auto alive = watcher.lock()) alive->End({grpc::StatusCode::UNAVAILABLE, "the server is shutting down"});
  }
}

grpc::ServerUnaryReactor* HealthService::Check(grpc::CallbackServerContext* context, const HealthCheckRequest* request,
                                               HealthCheckResponse* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (const absl::Status refused = door_(*context, Rpc::kHealthCheck); !refused.ok()) {
    reactor->Finish(ToGrpcStatus(refused));
    return reactor;
  }
  std::optional<ServingStatus> status;
  {
    const std::lock_guard lock(mutex_);
    status = StatusOf(request->service());
  }
  if (status) response->set_status(*status);
  reactor->Finish(status ? grpc::Status::OK : grpc::Status(grpc::StatusCode::NOT_FOUND, "service: not known here"));
  return reactor;
}

grpc::ServerWriteReactor<HealthCheckResponse>* HealthService::Watch(grpc::CallbackServerContext* context,
                                                                    const HealthCheckRequest* request) {
  const std::shared_ptr<Watcher> watcher = Watcher::Create();
  if (const absl::Status refused = door_(*context, Rpc::kHealthWatch); !refused.ok()) {
    watcher->End(ToGrpcStatus(refused));
    return watcher.get();
  }
  const std::lock_guard telling(telling_mutex_);
  std::optional<ServingStatus> status;
  {
    const std::lock_guard lock(mutex_);
    if (!ended_) {
      std::erase_if(watchers_, [](const auto& other) { return other.second.expired(); });
      watchers_.emplace_back(request->service(), watcher);
      status = StatusOf(request->service()).value_or(HealthCheckResponse::SERVICE_UNKNOWN);
    }
  }
  if (status) {
    watcher->Tell(*status);
  } else {
    watcher->End({grpc::StatusCode::UNAVAILABLE, "the server is shutting down"});
  }
  return watcher.get();
}

}  // namespace voxelpipe
