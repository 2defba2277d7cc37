// Limits the number of gRPC threads that serve connections.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <grpcpp/channel.h>

namespace voxelpipe {

// gRPC's callback API has one thread for every two cores, at least 2 and at most 16, which take turns: the one that
// finds an event wakes the next one to wait for more, and then handles it. With short calls that is a context switch
// for every event, which costs more than the event. This class blocks the other threads, so that fewer take turns.
//
// Our code never blocks on these threads, so one suffices; more of them speed up the work done on them (decryption,
// checksums of uploads).
class IoThreads {
 public:
  // Leaves `keep` threads, at least one. `channel`: of a server of this process that already serves. No effect if gRPC
  // has no such threads, or not more.
  IoThreads(size_t keep, const std::shared_ptr<grpc::Channel>& channel);
  // Releases all of them. Call before the server is destroyed.
  ~IoThreads();
  IoThreads(const IoThreads&) = delete;
  IoThreads& operator=(const IoThreads&) = delete;

  size_t held() const;

  // The current number in this process.
  static size_t Count();

 private:
  struct Call;
  struct Hold;
  const std::shared_ptr<Hold> hold_;
  std::vector<std::unique_ptr<Call>> calls_;
};

}  // namespace voxelpipe
