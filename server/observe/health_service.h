// grpc.health.v1 as a service of our own: gRPC's built-in one is not listed by reflection.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "grpc/health/v1/health.grpc.pb.h"

namespace voxelpipe {

// Knows two names: "" (the server) and "voxelpipe.v1.VoxelizationService". Both have the same health. Thread-safe.
class HealthService final : public grpc::health::v1::Health::CallbackService {
 public:
  using ServingStatus = grpc::health::v1::HealthCheckResponse::ServingStatus;

  HealthService();
  ~HealthService() override;

  // NOT_SERVING until told otherwise. Watchers hear of every change.
  void SetServing(bool serving);
  // Ends every Watch with UNAVAILABLE, so that the server can shut down without waiting for them.
  void EndWatches();

  // NOT_FOUND for a name that is not known.
  grpc::ServerUnaryReactor* Check(grpc::CallbackServerContext* context,
                                  const grpc::health::v1::HealthCheckRequest* request,
                                  grpc::health::v1::HealthCheckResponse* response) override;
  // The health now and at every change; SERVICE_UNKNOWN for a name that is not known.
  grpc::ServerWriteReactor<grpc::health::v1::HealthCheckResponse>* Watch(
      grpc::CallbackServerContext* context, const grpc::health::v1::HealthCheckRequest* request) override;

 private:
  class Watcher;

  std::mutex mutex_;
  ServingStatus status_;
  bool ended_ = false;
  std::vector<std::weak_ptr<Watcher>> watchers_;  // of known names
};

}  // namespace voxelpipe
