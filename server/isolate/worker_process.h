// The server's handle of a process that loads meshes.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "isolate/archive.h"
#include "isolate/channel.h"

namespace voxelpipe {

// One child process. Not thread-safe. It ends with this object, with the server, and with the thread that created it.
class WorkerProcess {
 public:
  struct Options {
    std::string program = "/proc/self/exe";  // with kLoadWorkerArgument
    int threads = 1;
    // Memory kept between requests: of shared memory in each direction, and of its heap. At most 1 GiB.
    uint64_t kept_bytes = 64 << 20;
  };

  // Starts the program; it is not ready yet. UNAVAILABLE if the system lacks processes, memory or descriptors.
  static absl::StatusOr<std::unique_ptr<WorkerProcess>> Start(const Options& options);
  // Kills it, if it is alive, and waits for its end, which takes long with gigabytes of memory.
  ~WorkerProcess();
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  pid_t pid() const { return pid_; }
  uint64_t kept_bytes() const { return options_.kept_bytes; }
  // True if it can take another request.
  bool usable() const { return end_reason_[0] == '\0'; }
  // True if it was ready for a request, and has ended since by itself: it is not usable any more then. Only between
  // requests.
  bool HasEnded();
  // True if it had ended by itself before the last request was sent, which it has not read.
  bool ended_unasked() const { return ended_unasked_; }
  // Why it is not: "cancelled", "deadline", "memory", "cpu", "protocol", "died", "start".
  const char* end_reason() const { return end_reason_; }

  // Waits until it is ready. UNAVAILABLE if it ends instead, for example if the kernel has no seccomp; the job's.
  absl::Status WaitUntilReady(const JobContext& job);

  // Sends a request and waits for the answer. `read` reads the result after the status, if the status is OK. The
  // process is killed, and is not usable any more, if it has not ended its work kPatience after the end of the job, if
  // it exceeds `memory_bytes` (0: no limit), or if it violates the protocol. Its memory is charged to the job while it
  // works; it is stopped while the charge waits for memory of others. `kept`: charged with the result once `read` has
  // read it. Errors: the answer's status; the job's; RESOURCE_EXHAUSTED for memory and CPU time; INTERNAL if the
  // process dies or violates the protocol.
  absl::Status Ask(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question, const JobContext& job,
                   const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept);

  // Releases unused memory. Only between requests.
  void Trim();

 private:
  explicit WorkerProcess(const Options& options) : options_(options) {}

  // Ask for a process that is ready; the memory of the messages is not released.
  absl::Status Exchange(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question, const JobContext& job,
                        const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept);
  absl::Status WaitForAnswer(uint64_t memory_bytes, const JobContext& job, MemoryCharge& charge, Message& answer);
  // Charges `bytes` more for the process, which is stopped while that waits.
  absl::Status ChargeMore(uint64_t bytes, MemoryCharge& charge);
  // The memory of the process beyond that at the start of the request.
  uint64_t TakenBytes();
  // Its current memory, including its answers.
  uint64_t ResidentBytes() const;
  // Ends the process, without waiting for its end.
  void Kill(const char* reason);
  // Waits for the end of the process, at most this long. Out: the status of waitpid.
  int Reap(std::chrono::milliseconds patience);
  // The error of a request when the process has ended by itself. `unasked`: see ended_unasked().
  absl::Status Died(bool unasked);

  const Options options_;
  pid_t pid_ = -1;
  std::unique_ptr<Channel> channel_;
  bool ready_ = false;
  const char* end_reason_ = "";
  bool ended_unasked_ = false;
  uint64_t number_ = 0;
  uint64_t base_space_ = 0;     // at the time it became ready
  uint64_t base_resident_ = 0;  // at that time, and before a request that follows a long one
  bool measure_ = false;        // true if that is to be measured
};

}  // namespace voxelpipe
