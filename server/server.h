// A running server: its services, its port, its shutdown.
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
class UnixSocket;
class VoxelizationServiceImpl;
class WebEndpoint;
class LoadWorkers;
struct ServiceState;

class VoxelServer {
 public:
  // Binds and serves. Errors: FAILED_PRECONDITION for a missing backend; UNAVAILABLE if the address cannot be bound.
  static absl::StatusOr<std::unique_ptr<VoxelServer>> Start(const ServerOptions& options);
  // Ends running jobs at once.
  ~VoxelServer();

  // The address with the chosen port.
  const std::string& address() const { return address_; }
  // The address of /metrics, /livez and /readyz; empty if there is none.
  const std::string& http_address() const { return http_address_; }
  // The address of the page; empty if there is none.
  const std::string& web_address() const { return web_address_; }

  // True if the server still works inside: its locks can be taken, and a call through gRPC's threads ends within
  // `patience`. Not to be called during or after Drain, when calls are refused. May block where the server is stuck.
  bool Answers(std::chrono::milliseconds patience);

  // Reads the tokens again, changed or not, and the machine limits. Changed certificates are read automatically.
  void Reload();

  // Graceful shutdown: reports NOT_SERVING, accepts calls for another options.lame_duck_ms so that calls in transit
  // arrive, then accepts no more and gives running ones options.drain_grace_ms. Returns when everything has ended. Call
  // once.
  void Drain();

 private:
  VoxelServer(const ServerOptions& asked, const MachineLimits& machine, std::unique_ptr<LoadWorkers> load_workers);
  // Reads the machine's limits; if they have changed, adapts all sizes that the options do not set.
  void FollowMachine();
  void DeviceChanged(const std::string& device, bool serving);
  // Starts the port for browsers.
  absl::Status ServeWeb();

  const ServerOptions asked_;  // with zeros that mean "choose"
  std::mutex machine_mutex_;
  MachineLimits machine_;  // the limits of the current sizes
  std::string address_, http_address_, web_address_;
  std::unique_ptr<ServiceState> state_;
  std::unique_ptr<VoxelizationServiceImpl> service_;
  std::unique_ptr<HealthService> health_;
  std::unique_ptr<ReflectionService> reflection_;  // null if disabled
  std::unique_ptr<ServerTls> tls_;
  std::unique_ptr<Metrics::Sampler> sampler_;
  std::unique_ptr<HttpEndpoint> http_;
  std::unique_ptr<Periodic> reloader_;
  std::unique_ptr<Periodic> memory_looker_;
  std::unique_ptr<Periodic> machine_looker_;
  std::unique_ptr<UnixSocket> unix_socket_;  // null if it listens on a port; outlives server_
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<IoThreads> io_threads_;
  std::unique_ptr<WebEndpoint> web_;
  std::mutex health_mutex_;
  std::set<std::string> serving_devices_;  // the server serves while there is at least one
  bool drained_ = false;
};

}  // namespace voxelpipe
