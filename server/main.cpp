// voxelpiped: the service.
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <google/protobuf/stubs/logging.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/mutex.h"
#include "access/periodic.h"
#include "base/text.h"
#include "check_files.h"
#include "isolate/load_worker.h"
#include "observe/log.h"
#include "observe/service_manager.h"
#include "options/options.h"
#include "probe.h"
#include "run/worker_pool.h"
#include "server.h"

namespace voxelpipe {
namespace {

sigset_t StopSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGHUP);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

int WaitForSignal(const sigset_t& signals) {
  int signal = 0;
  while (sigwait(&signals, &signal) != 0) {}
  return signal;
}

// Each connection takes a descriptor, and systems start programs with a soft limit far below the hard one.
void RaiseDescriptorLimit() {
  constexpr rlim_t kPlenty = 65'536;
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= kPlenty) return;
  files.rlim_cur = std::min(kPlenty, files.rlim_max);
  setrlimit(RLIMIT_NOFILE, &files);
}

// Time beyond lame duck and grace in which the process ends: its threads, its memory, an abandoned device.
constexpr std::chrono::seconds kEndPatience{10};

void LogIfFailed(const absl::Status& status) {
  if (!status.ok()) LogMessage(LogLevel::kWarn, std::string(status.message()));
}

// Tells the service manager that the process works, as long as it does; while it drains, when it refuses to be asked,
// the manager's limit of the stop applies.
class Watchdog {
 public:
  Watchdog(const ServiceManager& manager, VoxelServer& server) {
    const std::chrono::milliseconds interval = manager.alive_interval();
    if (interval.count() == 0) return;
    periodic_.emplace(interval, [this, &manager, &server, patience = interval / 2] {
      const std::lock_guard lock(mutex_);
      if (draining_ || server.Answers(patience)) {
        LogIfFailed(manager.Alive());
      } else {
        LogMessage(LogLevel::kError,
                   "the server does not answer itself; the service manager is not told that it works");
      }
    });
  }
  // The server is asked no more once this has returned.
  void Drain() {
    const std::lock_guard lock(mutex_);
    draining_ = true;
  }

 private:
  std::mutex mutex_;
  bool draining_ = false;
  std::optional<Periodic> periodic_;  // last member: its thread uses the others
};

int Serve(const ServerOptions& options) {
  RaiseDescriptorLimit();
  // gRPC uses Abseil's locks, which in debug builds keep a graph of all locks behind one lock.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  // Blocked in every thread started later; received by sigwait below, where any function may be called.
  const sigset_t signals = StopSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  StartLog(LevelOf(options.log_level), options.log_format == "json" ? LogFormat::kJson : LogFormat::kText);

  absl::StatusOr<std::unique_ptr<VoxelServer>> server = VoxelServer::Start(options);
  if (!server.ok()) {
    WriteLine(stderr, absl::StrCat("voxelpiped: ", server.status().message()));
    return 1;
  }
  WriteLine(stdout, "listening on " + (*server)->address());
  if (!(*server)->http_address().empty()) WriteLine(stdout, "http on " + (*server)->http_address());
  if (!(*server)->web_address().empty()) WriteLine(stdout, "web on http://" + (*server)->web_address());
  const ServiceManager manager = ServiceManager::OfEnvironment();
  LogIfFailed(manager.Ready("serving on " + (*server)->address()));
  std::optional<Watchdog> watchdog(std::in_place, manager, **server);

  int signal = WaitForSignal(signals);
  for (; signal == SIGHUP; signal = WaitForSignal(signals)) (*server)->Reload();
  LogMessage(LogLevel::kInfo, signal == SIGINT ? "SIGINT: draining" : "SIGTERM: draining");
  // A second signal ends at once.
  std::thread([signals] {
    int second = WaitForSignal(signals);
    while (second == SIGHUP) second = WaitForSignal(signals);
    _exit(128 + second);
  }).detach();
  LogIfFailed(manager.Stopping(kEndPatience + std::chrono::milliseconds(options.lame_duck_ms) +
                               std::chrono::milliseconds(options.drain_grace_ms)));
  watchdog->Drain();
  (*server)->Drain();
  server->reset();
  watchdog.reset();
  if (WorkerPool::ThreadsLeftBehind() > 0) {
    LogMessage(LogLevel::kWarn, absl::StrCat("ends without ", WorkerPool::ThreadsLeftBehind(),
                                             " threads that do not come back from a device"));
    StopLog();
    std::fflush(stdout);
    _exit(0);  // abandoned threads may use static objects
  }
  return 0;
}

// The server starts its own processes with this, the number of their threads and the bytes that they may keep
// (isolate/worker_process.h).
bool IsLoadWorker(int argc, char** argv) {
  return argc == 4 && std::strcmp(argv[1], kLoadWorkerArgument) == 0;
}

int Main(int argc, char** argv) {
  if (IsLoadWorker(argc, argv))
    _exit(RunLoadWorker(std::atoi(argv[2]), std::atoi(argv[3])));  // nothing of the server was initialized
  const ParseOutcome parsed = ParseCommandLine(argc, argv);
  if (!parsed.command) return parsed.exit_code;
  if (parsed.command->check_config) {
    const std::vector<std::string> lines =
        absl::StrSplit(ToConfigText(parsed.command->values), '\n', absl::SkipEmpty());
    for (const std::string& line : lines) WriteLine(stdout, line);
    const absl::Status status = CheckFiles(parsed.command->options);
    if (!status.ok()) WriteLine(stderr, absl::StrCat("voxelpiped: ", status.message()));
    return status.ok() ? 0 : 2;
  }
  if (parsed.command->probe) return Probe(*parsed.command->probe, TlsOf(parsed.command->options));
  google::protobuf::SetLogHandler(nullptr);  // otherwise each malformed message from a client is a line on stderr
  const int exit_code = Serve(parsed.command->options);
  StopLog();
  return exit_code;
}

}  // namespace
}  // namespace voxelpipe

int main(int argc, char** argv) {
  try {
    return voxelpipe::Main(argc, argv);
  } catch (const std::exception& error) {
    voxelpipe::WriteLine(stderr, absl::StrCat("voxelpiped: ", error.what()));
    return 1;
  }
}
