// grpc.health.v1 as a service of our own: gRPC's built-in one is not listed by reflection.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "observe/metrics.h"

namespace voxelpipe {

// Serves the names "" (the server) and "voxelpipe.v1.VoxelizationService", with the same health, and "device/NAME" for
// each device that was set. Thread-safe.
class HealthService final : public grpc::health::v1::Health::CallbackService {
 public:
  using ServingStatus = grpc::health::v1::HealthCheckResponse::ServingStatus;

  // True if this caller may read the health; called once a call, on gRPC's thread.
  using Door = std::function<absl::Status(const grpc::CallbackServerContext&, Rpc)>;

  explicit HealthService(Door door);
  ~HealthService() override;

  // NOT_SERVING until set; meanwhile the devices are NOT_SERVING too. Watchers are notified of every change.
  void SetServing(bool serving);
  // Of the device "cpu", "cuda:0", ...: true while it takes jobs. A device that was never set is unknown.
  void SetDevice(const std::string& device, bool serving);
  // True if the server serves: the health of "".
  bool serving() const;
  // Ends every Watch with UNAVAILABLE, so that the server can shut down without waiting for them.
  void EndWatches();

  // NOT_FOUND for an unknown name.
  grpc::ServerUnaryReactor* Check(grpc::CallbackServerContext* context,
                                  const grpc::health::v1::HealthCheckRequest* request,
                                  grpc::health::v1::HealthCheckResponse* response) override;
  // The health now and at every change; SERVICE_UNKNOWN for an unknown name.
  grpc::ServerWriteReactor<grpc::health::v1::HealthCheckResponse>* Watch(
      grpc::CallbackServerContext* context, const grpc::health::v1::HealthCheckRequest* request) override;

 private:
  class Watcher;

  const Door door_;

  // With mutex_ held. Empty for an unknown name.
  std::optional<ServingStatus> StatusOf(const std::string& name) const;
  // Notifies every watcher.
  void TellAll();

  std::mutex telling_mutex_;  // one notification at a time; taken before mutex_
  mutable std::mutex mutex_;
  bool serving_ = false, ended_ = false;
  std::map<std::string, bool> devices_;  // "device/NAME" -> true if it takes jobs
  std::vector<std::pair<std::string, std::weak_ptr<Watcher>>> watchers_;
};

}  // namespace voxelpipe
