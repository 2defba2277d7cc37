// A small HTTP server beside the service, for Prometheus and for health probes over HTTP.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

struct MHD_Daemon;
struct MHD_Connection;

namespace voxelpipe {

class Metrics;

// GET /metrics (Prometheus' text format), /livez (200 while the process answers), /readyz (200 while the service takes
// calls, 503 otherwise). Nothing else. One thread of its own serves all connections, at most kMaxConnections, event by
// event: slow ones delay no other. An idle one is closed after two seconds.
class HttpEndpoint {
 public:
  // Each takes up to 8 KiB and a descriptor.
  static constexpr unsigned kMaxConnections = 4096;

  // In: "HOST:PORT", or "PORT" for every address; port 0 picks one. `ready` is called on the endpoint's thread; it and
  // `metrics` must outlive it. Errors: INVALID_ARGUMENT for an invalid address, UNAVAILABLE if it cannot be bound.
  static absl::StatusOr<std::unique_ptr<HttpEndpoint>> Start(const std::string& listen, Metrics& metrics,
                                                             std::function<bool()> ready);
  // Ends running requests.
  ~HttpEndpoint();
  HttpEndpoint(const HttpEndpoint&) = delete;
  HttpEndpoint& operator=(const HttpEndpoint&) = delete;

  // HOST:PORT with the chosen port.
  const std::string& address() const { return address_; }

 private:
  friend struct HttpAnswers;

  HttpEndpoint(Metrics& metrics, std::function<bool()> ready) : metrics_(metrics), ready_(std::move(ready)) {}

  Metrics& metrics_;
  const std::function<bool()> ready_;
  std::string address_;
  MHD_Daemon* daemon_ = nullptr;
};

}  // namespace voxelpipe
