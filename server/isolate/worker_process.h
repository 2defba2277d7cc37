// A process that loads meshes, seen from the server.
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

// One child. Not thread-safe. It ends with this object, with the server, and with the thread that made it.
class WorkerProcess {
 public:
  struct Options {
    std::string program = "/proc/self/exe";  // with kLoadWorkerArgument
    int threads = 1;
    // Kept from question to question: of shared memory, each way, and of its heap. At most 1 GiB.
    uint64_t kept_bytes = 64 << 20;
  };

  // Starts the program; it is not ready yet. UNAVAILABLE where the system gives no process, no memory or no
  // descriptors.
  static absl::StatusOr<std::unique_ptr<WorkerProcess>> Start(const Options& options);
  // Kills it, if it lives, and waits for its end: that of one with gigabytes takes its time.
  ~WorkerProcess();
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  pid_t pid() const { return pid_; }
  uint64_t kept_bytes() const { return options_.kept_bytes; }
  // True if it can take another request.
  bool usable() const { return end_reason_[0] == '\0'; }
  // Why it is not: "cancelled", "deadline", "memory", "cpu", "protocol", "died", "start".
  const char* end_reason() const { return end_reason_; }

  // Waits until it has said that it is ready. UNAVAILABLE where it ends instead, as where the kernel has no seccomp;
  // the job's.
  absl::Status WaitUntilReady(const JobContext& job);

  // Asks, and waits for the answer. `read` reads what stands behind the status; it is called where the status is OK.
  // The process is killed, and is not usable any more, when it has not ended its work kPatience after the job was over,
  // when it takes more than `memory_bytes` (0: no bound), and when it does not keep to the protocol. What it takes is
  // charged to the job while it works; it stands still while that has to wait for others' memory. `kept`: what was read
  // is charged to it once `read` has read it. Errors: the answer's status; the job's; RESOURCE_EXHAUSTED for memory and
  // processor time; INTERNAL where the process dies or is broken.
  absl::Status Ask(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question, const JobContext& job,
                   const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept);

  // Gives back memory that is not in use. Only between questions.
  void Trim();

 private:
  explicit WorkerProcess(const Options& options) : options_(options) {}

  // Ask, of a process that is ready; the memory of the messages is not given back.
  absl::Status Exchange(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question, const JobContext& job,
                        const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept);
  absl::Status WaitForAnswer(uint64_t memory_bytes, const JobContext& job, MemoryCharge& charge, Message& answer);
  // Takes `bytes` more for the process, which does not run while that waits.
  absl::Status ChargeMore(uint64_t bytes, MemoryCharge& charge);
  // What the process takes beyond what it took when it was asked.
  uint64_t TakenBytes();
  // What it takes now, its answers included.
  uint64_t ResidentBytes() const;
  // Ends the process, without waiting for its end.
  void Kill(const char* reason);
  // Waits for the end of the process, at most so long. Out: how it ended, of waitpid.
  int Reap(std::chrono::milliseconds patience);
  absl::Status Died();

  const Options options_;
  pid_t pid_ = -1;
  std::unique_ptr<Channel> channel_;
  bool ready_ = false;
  const char* end_reason_ = "";
  uint64_t number_ = 0;
  uint64_t base_space_ = 0;     // when it became ready
  uint64_t base_resident_ = 0;  // then, and before a question that follows a long one
  bool measure_ = false;        // true if that is to be measured
};

}  // namespace voxelpipe
