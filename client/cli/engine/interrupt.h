// Ctrl-C cancels the running job, which leaves no half-written file; a second Ctrl-C, half a second or more later, ends
// the process at once.
#pragma once

#include <string>

#include "base/job_context.h"

namespace voxelpipe::cli {

// Installs the handlers of SIGINT, SIGTERM and, unless it is already ignored (nohup), SIGHUP. Ignores SIGXFSZ and
// SIGPIPE: writing then fails with EFBIG or EPIPE, which can be reported and cleaned up after. Once.
void HandleInterrupts();

// The received signal, or 0.
int InterruptSignal();

// The exit code of a run stopped by a signal: 128 + signal, 1 for SIGHUP; and its message.
int StoppedExitCode(int signal);
std::string StoppedReason(int signal);

// During its lifetime, a signal cancels `job`. One object at a time.
class CancelOnInterrupt {
 public:
  explicit CancelOnInterrupt(JobContext& job);
  ~CancelOnInterrupt();
  CancelOnInterrupt(const CancelOnInterrupt&) = delete;
  CancelOnInterrupt& operator=(const CancelOnInterrupt&) = delete;
};

}  // namespace voxelpipe::cli
