// What all requests of the page's port share.
#pragma once

#include <memory>
#include <utility>

#include <grpcpp/channel.h>

#include "state/service_state.h"
#include "web/http/origin_rules.h"

namespace voxelpipe {

// Must outlive all requests.
struct WebContext {
  WebContext(ServiceState& of_server, std::shared_ptr<grpc::Channel> to_server, OriginRules rules)
      : state(of_server), channel(std::move(to_server)), origins(std::move(rules)) {}

  ServiceState& state;
  const std::shared_ptr<grpc::Channel> channel;  // of the server itself
  const OriginRules origins;
};

}  // namespace voxelpipe
