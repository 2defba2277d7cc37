#include "interrupt.h"

#include <atomic>
#include <csignal>

namespace voxelpipe::cli {
namespace {

std::atomic<JobContext*> running{nullptr};
std::atomic<int> received{0};
static_assert(std::atomic<JobContext*>::is_always_lock_free && std::atomic<int>::is_always_lock_free,
              "a signal handler may only touch lock-free atomics");

void OnSignal(int signal) {
  received = signal;
  if (JobContext* job = running; job != nullptr) job->Cancel();
}

}  // namespace

void HandleInterrupts() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);  // the second one has the default effect
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

int InterruptSignal() {
  return received;
}

CancelOnInterrupt::CancelOnInterrupt(JobContext& job) {
  running = &job;
  if (received != 0) job.Cancel();  // it may have come just before
}

CancelOnInterrupt::~CancelOnInterrupt() {
  running = nullptr;
}

}  // namespace voxelpipe::cli
