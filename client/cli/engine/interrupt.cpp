#include "engine/interrupt.h"

#include <time.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdint>

namespace voxelpipe::cli {
namespace {

std::atomic<JobContext*> running{nullptr};
std::atomic<int> received{0};
std::atomic<int64_t> received_ms{0};
static_assert(std::atomic<JobContext*>::is_always_lock_free && std::atomic<int>::is_always_lock_free &&
                  std::atomic<int64_t>::is_always_lock_free,
              "a signal handler may only touch lock-free atomics");

int64_t NowMs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);  // allowed in a signal handler
  return int64_t(now.tv_sec) * 1000 + now.tv_nsec / 1000000;
}

void OnSignal(int signal) {
  // The same stop may arrive twice: timeout(1), for one, signals the process and then its group.
  constexpr int64_t kSameStopMs = 500;
  if (received != 0 && NowMs() - received_ms > kSameStopMs) _exit(128 + signal);
  if (received == 0) received_ms = NowMs();
  received = signal;
  if (JobContext* job = running; job != nullptr) job->Cancel();
}

}  // namespace

void HandleInterrupts() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup {};
  if (sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
}

int InterruptSignal() {
  return received;
}

int StoppedExitCode(int signal) {
  return signal == SIGHUP ? 1 : 128 + signal;
}

std::string StoppedReason(int signal) {
  return signal == SIGHUP ? "stopped: the terminal or session was closed (SIGHUP)" : "stopped";
}

CancelOnInterrupt::CancelOnInterrupt(JobContext& job) {
  running = &job;
  if (received != 0) job.Cancel();  // it may have arrived just before
}

CancelOnInterrupt::~CancelOnInterrupt() {
  running = nullptr;
}

}  // namespace voxelpipe::cli
