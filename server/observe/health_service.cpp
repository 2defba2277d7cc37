#include "observe/health_service.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace voxelpipe {
namespace {

using grpc::health::v1::HealthCheckRequest;
using grpc::health::v1::HealthCheckResponse;

bool IsKnown(const std::string& name) {
  return name.empty() || name == "voxelpipe.v1.VoxelizationService";
}

}  // namespace

// One Watch call. Writes one status at a time; of several changes in between only the last is told.
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

HealthService::HealthService() : status_(HealthCheckResponse::NOT_SERVING) {}
HealthService::~HealthService() = default;

void HealthService::SetServing(bool serving) {
  std::vector<std::shared_ptr<Watcher>> told;
  const std::lock_guard lock(mutex_);
  status_ = serving ? HealthCheckResponse::SERVING : HealthCheckResponse::NOT_SERVING;
  for (const auto& watcher : watchers_) {
    if (auto alive = watcher.lock()) {
      alive->Tell(status_);
      told.push_back(std::move(alive));
    }
  }
}

void HealthService::EndWatches() {
  std::vector<std::weak_ptr<Watcher>> watchers;
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    watchers.swap(watchers_);
  }
  for (const auto& watcher : watchers) {
    if (const auto alive = watcher.lock()) alive->End({grpc::StatusCode::UNAVAILABLE, "the server is shutting down"});
  }
}

grpc::ServerUnaryReactor* HealthService::Check(grpc::CallbackServerContext* context, const HealthCheckRequest* request,
                                               HealthCheckResponse* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (!IsKnown(request->service())) {
    reactor->Finish({grpc::StatusCode::NOT_FOUND, "service: not known here"});
    return reactor;
  }
  {
    const std::lock_guard lock(mutex_);
    response->set_status(status_);
  }
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerWriteReactor<HealthCheckResponse>* HealthService::Watch(grpc::CallbackServerContext* /*context*/,
                                                                    const HealthCheckRequest* request) {
  const std::shared_ptr<Watcher> watcher = Watcher::Create();
  const std::lock_guard lock(mutex_);
  if (ended_) {
    watcher->End({grpc::StatusCode::UNAVAILABLE, "the server is shutting down"});
    return watcher.get();
  }
  std::erase_if(watchers_, [](const auto& other) { return other.expired(); });
  watchers_.push_back(watcher);
  watcher->Tell(IsKnown(request->service()) ? status_ : HealthCheckResponse::SERVICE_UNKNOWN);
  return watcher.get();
}

}  // namespace voxelpipe
