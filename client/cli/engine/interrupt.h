// Ctrl-C: the running job is cancelled and leaves no half-written file; a second Ctrl-C, half a second
// or more later, ends the process at once.
#pragma once

#include <string>

#include "base/job_context.h"

namespace voxelpipe::cli {

// Installs the handlers of SIGINT, SIGTERM and, unless it is ignored already (nohup), SIGHUP. Ignores SIGXFSZ and
// SIGPIPE: writing then fails with EFBIG or EPIPE, which can be reported and cleaned up after. Once.
void HandleInterrupts();

// The signal that came, or 0.
int InterruptSignal();

// What a run that such a signal stopped exits with: 128 + signal, 1 for SIGHUP; and what it says.
int StoppedExitCode(int signal);
std::string StoppedReason(int signal);

// While it lives, a signal cancels `job`. One at a time.
class CancelOnInterrupt {
 public:
  explicit CancelOnInterrupt(JobContext& job);
  ~CancelOnInterrupt();
  CancelOnInterrupt(const CancelOnInterrupt&) = delete;
  CancelOnInterrupt& operator=(const CancelOnInterrupt&) = delete;
};

}  // namespace voxelpipe::cli
