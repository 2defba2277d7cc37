// The port for browsers: the page, gRPC-Web, and files of results.
#pragma once

#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include <grpcpp/channel.h>

#include "absl/status/statusor.h"
#include "access/periodic.h"
#include "web/http/client_network.h"
#include "web/http/web_context.h"

struct MHD_Daemon;
struct MHD_Connection;

namespace voxelpipe {

// HTTP/1.1 in plain text, one request a connection, each on a thread of its own: kMaxWebConnections at most.
//   GET  /, /page.js, ...                            the page
//   POST /voxelpipe.v1.VoxelizationService/METHOD    a call as gRPC-Web (frames.h)
//   POST /file?format=NAME                           a result as a file (result_download.h)
// A request must come from a page of this port or of an allowed origin, or from no page (origin_rules.h).
class WebEndpoint {
 public:
  // Serves state.options.web_listen. `channel`: of the server itself, in this process. Both must outlive the endpoint.
  // Errors: INVALID_ARGUMENT for invalid options, UNAVAILABLE if the address cannot be bound.
  static absl::StatusOr<std::unique_ptr<WebEndpoint>> Start(ServiceState& state,
                                                            std::shared_ptr<grpc::Channel> channel);
  // Ends running requests.
  ~WebEndpoint();
  WebEndpoint(const WebEndpoint&) = delete;
  WebEndpoint& operator=(const WebEndpoint&) = delete;

  // HOST:PORT with the chosen port.
  const std::string& address() const { return address_; }

  // Accepts no more connections and waits until all requests are answered, at most until `deadline`. Call once.
  void Drain(std::chrono::steady_clock::time_point deadline);

 private:
  friend struct WebCallbacks;
  struct Connection {
    int socket;
    ClientNetwork client;
    std::chrono::steady_clock::time_point opened;
    bool has_head = false;
  };

  WebEndpoint(ServiceState& state, std::shared_ptr<grpc::Channel> channel, std::string address, OriginRules origins);
  // True if a client may open a further connection.
  bool HasRoomFor(const ClientNetwork& client);
  // Closes connections whose head takes too long.
  void CloseSlowHeads();

  WebContext web_;
  const std::string address_;
  MHD_Daemon* daemon_ = nullptr;
  int listening_ = -1;  // the socket, after Drain
  std::mutex mutex_;
  std::condition_variable completed_;
  size_t requests_ = 0;  // whose head has arrived and whose answer is not sent
  std::map<const MHD_Connection*, Connection> connections_;
  std::unique_ptr<Periodic> watch_;
};

}  // namespace voxelpipe
