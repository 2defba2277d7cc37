// A small HTTP server beside the service, for Prometheus and for whoever asks over HTTP whether the server lives.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

struct mg_connection;
struct mg_context;

namespace voxelpipe {

class Metrics;

// GET /metrics (Prometheus' text format), /livez (200 while the process answers), /readyz (200 while the service takes calls, 503
// otherwise). Nothing else, and no file. Eight threads of its own serve the connections that fit into a bounded queue; one that
// says nothing is let go after two seconds, so that a few of them keep nobody from being answered.
class HttpEndpoint {
 public:
  // In: "HOST:PORT", or "PORT" for every address; port 0 picks one. `ready` is called on the endpoint's threads; it and `metrics` must outlive it.
  // Errors: INVALID_ARGUMENT for an address that is none, UNAVAILABLE where it cannot be bound.
  static absl::StatusOr<std::unique_ptr<HttpEndpoint>> Start(const std::string& listen, Metrics& metrics,
                                                             std::function<bool()> ready);
  // Ends what is being answered.
  ~HttpEndpoint();
  HttpEndpoint(const HttpEndpoint&) = delete;
  HttpEndpoint& operator=(const HttpEndpoint&) = delete;

  // HOST:PORT with the port that was picked.
  const std::string& address() const { return address_; }

 private:
  HttpEndpoint(Metrics& metrics, std::function<bool()> ready) : metrics_(metrics), ready_(std::move(ready)) {}
  static int Answer(mg_connection* connection, void* self);
  int Answer(mg_connection* connection);

  Metrics& metrics_;
  const std::function<bool()> ready_;
  std::string address_;
  mg_context* context_ = nullptr;
};

// GET http://ADDRESS/PATH. Out: the status code, or 0 with one line in `error` where there is no answer within `timeout_ms`.
int HttpStatusOf(const std::string& address, const std::string& path, int timeout_ms, std::string& error);

}  // namespace voxelpipe
