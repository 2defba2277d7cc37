// Ctrl-C: the running job is cancelled and leaves no half-written file; a second Ctrl-C, half a second
// or more later, ends the process at once.
#pragma once

#include "base/job_context.h"

namespace voxelpipe::cli {

// Installs the handlers of SIGINT and SIGTERM, once.
void HandleInterrupts();

// The signal that came, or 0.
int InterruptSignal();

// While it lives, a signal cancels `job`. One at a time.
class CancelOnInterrupt {
 public:
  explicit CancelOnInterrupt(JobContext& job);
  ~CancelOnInterrupt();
  CancelOnInterrupt(const CancelOnInterrupt&) = delete;
  CancelOnInterrupt& operator=(const CancelOnInterrupt&) = delete;
};

}  // namespace voxelpipe::cli
