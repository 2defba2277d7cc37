// How many of gRPC's threads serve the connections.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <grpcpp/channel.h>

namespace voxelpipe {

// gRPC's callback API has one thread for every two cores, at least 2 and at most 16, which take turns: the one that
// finds an event wakes the next one to wait for more, and then handles it. With short calls that is a change of threads
// for every event, and costs more than the event. This keeps the rest of them waiting, so that fewer take turns.
//
// None of ours ever blocks on these threads, so one is enough to serve; what it does itself (decryption, checksums of
// uploads) is what more of them do faster.
class IoThreads {
 public:
  // Leaves `keep` threads, at least one. `channel`: of a server of this process that serves already. Where gRPC has no
  // such threads, or not more, all stay as they are.
  IoThreads(size_t keep, const std::shared_ptr<grpc::Channel>& channel);
  // Lets all of them go on. Before the server goes.
  ~IoThreads();
  IoThreads(const IoThreads&) = delete;
  IoThreads& operator=(const IoThreads&) = delete;

  size_t held() const;

  // Of this process now.
  static size_t Count();

 private:
  struct Call;
  struct Hold;
  const std::shared_ptr<Hold> hold_;
  std::vector<std::unique_ptr<Call>> calls_;
};

}  // namespace voxelpipe
