// A running server: its services, its port, its end.
#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "absl/status/statusor.h"
#include "base/machine.h"
#include "observe/metrics.h"
#include "options/options.h"

namespace grpc {
class Server;
}

namespace voxelpipe {

class HealthService;
class ReflectionService;
class HttpEndpoint;
class IoThreads;
class Periodic;
class ServerTls;
class VoxelizationServiceImpl;
class LoadWorkers;
struct ServiceState;

class VoxelServer {
 public:
  // Binds and serves. Errors: FAILED_PRECONDITION for a backend that is not there; UNAVAILABLE when the address cannot
  // be bound.
  static absl::StatusOr<std::unique_ptr<VoxelServer>> Start(const ServerOptions& options);
  // Ends at once what still runs.
  ~VoxelServer();

  // The address with the port that was picked.
  const std::string& address() const { return address_; }
  // Of /metrics, /livez and /readyz; empty where there is none.
  const std::string& http_address() const { return http_address_; }

  // Reads tokens again, whether they have changed or not, and what the process has of the machine. Changed certificates
  // are read by themselves.
  void Reload();

  // Graceful end: says NOT_SERVING, takes calls for another options.lame_duck_ms so that those on their way arrive,
  // then takes no more and gives those that run options.drain_grace_ms. Returns when everything has ended. Call once.
  void Drain();

 private:
  VoxelServer(const ServerOptions& asked, const MachineLimits& machine, std::unique_ptr<LoadWorkers> load_workers);
  // Reads the machine's limits, and where they have changed, makes all follow that has no size of its own in the
  // options.
  void FollowMachine();
  void DeviceChanged(const std::string& device, bool serving);

  const ServerOptions asked_;  // with zeros that mean "choose"
  std::mutex machine_mutex_;
  MachineLimits machine_;  // that all was made for
  std::string address_, http_address_;
  std::unique_ptr<ServiceState> state_;
  std::unique_ptr<VoxelizationServiceImpl> service_;
  std::unique_ptr<HealthService> health_;
  std::unique_ptr<ReflectionService> reflection_;  // null where the operator wants none
  std::unique_ptr<ServerTls> tls_;
  std::unique_ptr<Metrics::Sampler> sampler_;
  std::unique_ptr<HttpEndpoint> http_;
  std::unique_ptr<Periodic> reloader_;
  std::unique_ptr<Periodic> memory_looker_;
  std::unique_ptr<Periodic> machine_looker_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<IoThreads> io_threads_;
  std::mutex health_mutex_;
  std::set<std::string> serving_devices_;  // the server serves while there is one
  bool drained_ = false;
};

}  // namespace voxelpipe
