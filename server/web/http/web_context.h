// What all requests of the page's port share.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include <grpcpp/channel.h>

#include "schedule/byte_budget.h"
#include "state/service_state.h"
#include "web/http/origin_rules.h"

namespace voxelpipe {

// Functions that the port's own thread calls several times a second. Thread-safe.
class WebWatches {
 public:
  // Its function is called during its lifetime.
  class Watch {
   public:
    Watch(WebWatches& all, std::function<void()> look) : all_(all) {
      const std::lock_guard lock(all_.mutex_);
      place_ = all_.looks_.insert(all_.looks_.end(), std::move(look));
    }
    ~Watch() {
      const std::lock_guard lock(all_.mutex_);
      all_.looks_.erase(place_);
    }
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

   private:
    WebWatches& all_;
    std::list<std::function<void()>>::iterator place_;
  };

  void Look() {
    const std::lock_guard lock(mutex_);
    for (const std::function<void()>& look : looks_) look();
  }

 private:
  std::mutex mutex_;
  std::list<std::function<void()>> looks_;
};

// Must outlive all requests.
struct WebContext {
  WebContext(ServiceState& of_server, std::shared_ptr<grpc::Channel> to_server, OriginRules rules)
      : state(of_server),
        channel(std::move(to_server)),
        origins(std::move(rules)),
        files(of_server.options.web_file_bytes) {}

  ServiceState& state;
  const std::shared_ptr<grpc::Channel> channel;  // of the server itself
  const OriginRules origins;
  ByteBudget files;               // temporary files of /file
  std::atomic<int> file_runs{0};  // requests of /file that make their file now
  WebWatches watches;
};

}  // namespace voxelpipe
