// Binds a call to its job.
#pragma once

#include <grpcpp/client_context.h>

#include "absl/status/status.h"
#include "base/job_context.h"

namespace voxelpipe {

// Sends the job's deadline with the call, and during its lifetime cancels the call as soon as the job should end. Both
// must outlive it. JobContext is a flag without notification (signal handlers set it), so one thread polls it every ten
// milliseconds for all calls of the process.
class CallWatch {
 public:
  CallWatch(grpc::ClientContext& context, const JobContext& job);
  ~CallWatch();
  CallWatch(const CallWatch&) = delete;
  CallWatch& operator=(const CallWatch&) = delete;

 private:
  friend class CallWatcher;
  grpc::ClientContext& context_;
  const JobContext& job_;
  bool cancelled_ = false;  // guarded by the watcher's lock
};

// The status of an ended call as the caller should see it: the job's own reason if the job ended the call, otherwise
// the server's; UNAVAILABLE names `target`. A call that the server has cancelled is UNAVAILABLE, one that it does not
// know an OtherContractError.
absl::Status CallStatus(const grpc::Status& status, const JobContext& job, const std::string& target);

}  // namespace voxelpipe
