#include "isolate/worker_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "isolate/load_worker.h"
#include "isolate/mesh_fields.h"
#include "isolate/sandbox.h"

extern char** environ;

namespace voxelpipe {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// How often job and memory are polled while the process works.
constexpr milliseconds kLookInterval{10};
// Grace from the end of the job to killing the process.
constexpr milliseconds kPatience{50};
constexpr milliseconds kStartPatience{10'000};
// The limit of CPU time for any file; a deadline may be shorter.
constexpr uint64_t kMaxCpuSeconds = 600;
// Changes in memory below this are noise of the allocator.
constexpr uint64_t kSlackBytes = 16 << 20;

// The variables that the dynamic loader or a sanitizer needs; decoders get no others.
std::vector<char*> Environment() {
  std::vector<char*> kept;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    for (const std::string_view start : {"LD_LIBRARY_PATH=", "ASAN_OPTIONS=", "UBSAN_OPTIONS=", "TSAN_OPTIONS="}) {
      if (std::string_view(*variable).substr(0, start.size()) == start) kept.push_back(*variable);
    }
  }
  kept.push_back(nullptr);
  return kept;
}

// Of posix_spawn: descriptors and signals of the child.
class SpawnSettings {
 public:
  SpawnSettings() {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnSettings(const SpawnSettings&) = delete;

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
};

// Out: 0, or the error.
int Spawn(const WorkerProcess::Options& options, const std::array<int, 3>& descriptors, pid_t& pid) {
  SpawnSettings settings;
  posix_spawn_file_actions_addopen(&settings.actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&settings.actions, 1, "/dev/null", O_WRONLY, 0);
  // Its only output is a report of a sanitizer; untrusted input must not write to our log.
  if (!IsSanitizedBuild()) posix_spawn_file_actions_addopen(&settings.actions, 2, "/dev/null", O_WRONLY, 0);
  // First moves the descriptors out of the target range.
  const int free = std::max(kWorkerOut, *std::max_element(descriptors.begin(), descriptors.end())) + 1;
  for (int i = 0; i < 3; ++i) posix_spawn_file_actions_adddup2(&settings.actions, descriptors[size_t(i)], free + i);
  for (int i = 0; i < 3; ++i) posix_spawn_file_actions_adddup2(&settings.actions, free + i, kWorkerSocket + i);
  posix_spawn_file_actions_addclosefrom_np(&settings.actions, kWorkerOut + 1);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&settings.attributes, &none);
  posix_spawnattr_setsigdefault(&settings.attributes, &all);
  posix_spawnattr_setflags(&settings.attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  constexpr uint64_t kMaxKept = uint64_t{1} << 30;
  std::string name = "voxelpiped", mode = kLoadWorkerArgument, threads = std::to_string(options.threads),
              kept = std::to_string(std::min(options.kept_bytes, kMaxKept));
  char* const arguments[] = {name.data(), mode.data(), threads.data(), kept.data(), nullptr};
  return posix_spawn(&pid, options.program.c_str(), &settings.actions, &settings.attributes, arguments,
                     Environment().data());
}

}  // namespace

absl::StatusOr<std::unique_ptr<WorkerProcess>> WorkerProcess::Start(const Options& options) {
  const auto unavailable = [](std::string_view what, const absl::Status& why) {
    return absl::UnavailableError(absl::StrCat(
        "cannot start a process that loads meshes: ", absl::string_view(what.data(), what.size()), why.message()));
  };
  absl::StatusOr<SharedRegion> to = SharedRegion::Create();
  if (!to.ok()) return unavailable("", to.status());
  absl::StatusOr<SharedRegion> from = SharedRegion::Create();
  if (!from.ok()) return unavailable("", from.status());
  int sockets[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets) != 0) {
    return unavailable("", absl::ErrnoToStatus(errno, "socketpair"));
  }
  std::unique_ptr<WorkerProcess> worker(new WorkerProcess(options));
  const std::array<int, 3> descriptors = {sockets[1], to->fd(), from->fd()};
  const int error = Spawn(options, descriptors, worker->pid_);
  close(sockets[1]);
  worker->channel_ = std::make_unique<Channel>(sockets[0], *std::move(to), *std::move(from), false);
  if (error == 0) return worker;
  worker->pid_ = -1;
  return unavailable("", absl::ErrnoToStatus(error, options.program));
}

WorkerProcess::~WorkerProcess() {
  if (usable()) Kill("");
  Reap(milliseconds::max());
}

void WorkerProcess::Kill(const char* reason) {
  end_reason_ = reason;
  if (pid_ > 0) kill(pid_, SIGKILL);
}

int WorkerProcess::Reap(milliseconds patience) {
  int status = 0;
  if (pid_ <= 0) return status;
  const bool wait = patience == milliseconds::max();
  const Clock::time_point end = wait ? Clock::time_point::max() : Clock::now() + patience;
  while (true) {
    const pid_t ended = waitpid(pid_, &status, wait ? 0 : WNOHANG);
    if (ended == pid_ || (ended < 0 && errno != EINTR)) {
      pid_ = -1;
      return status;
    }
    if (Clock::now() >= end) return 0;
    if (!wait) usleep(1000);
  }
}

bool WorkerProcess::HasEnded() {
  // One that has not become ready has a reason of its own, which WaitUntilReady tells.
  if (usable() && channel_->IsClosed() && (ready_ || channel_->HasMessage())) Kill("died");
  return !usable();
}

absl::Status WorkerProcess::Died(bool unasked) {
  ended_unasked_ = unasked;
  // It has closed its socket, so it ends by itself, with a reason of its own.
  int status = Reap(milliseconds(50));
  Kill("died");
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) {
    end_reason_ = "cpu";
    return absl::ResourceExhaustedError(
        absl::StrCat("loading the mesh took more than ", kMaxCpuSeconds, " s of processor time"));
  }
  std::string how = "ended";
  if (WIFSIGNALED(status)) {
    how = absl::StrCat("was ended by signal ", WTERMSIG(status));
    if (const char* const name = sigabbrev_np(WTERMSIG(status)); name != nullptr)
      absl::StrAppend(&how, " (SIG", name, ")");
  } else if (WIFEXITED(status)) {
    how = absl::StrCat("ended with code ", WEXITSTATUS(status));
  }
  return absl::InternalError(
      absl::StrCat("the process that loaded the mesh ", how, "; its file may be broken or made to do harm"));
}

absl::Status WorkerProcess::WaitUntilReady(const JobContext& job) {
  const Clock::time_point end = Clock::now() + kStartPatience;
  while (!ready_) {
    const absl::StatusOr<Message> message = channel_->Receive(kLookInterval, 0);
    if (absl::IsDeadlineExceeded(message.status())) {
      if (absl::Status s = job.Check(); !s.ok()) return s;
      if (Clock::now() < end) continue;
      Kill("start");
      return absl::UnavailableError("a process that loads meshes does not start");
    }
    if (!message.ok() || message->kind != MessageKind::kReady) {
      const int status = Reap(milliseconds(50));
      ended_unasked_ = true;
      Kill("start");
      return absl::UnavailableError(absl::StrCat(
          "a process that loads meshes cannot start",
          WIFEXITED(status) && WEXITSTATUS(status) == 3 ? ": this system does not let it use seccomp" : ""));
    }
    ready_ = true;
    base_space_ = AddressSpaceBytes(pid_);
    base_resident_ = ResidentBytes();
  }
  return absl::OkStatus();
}

uint64_t WorkerProcess::ResidentBytes() const {
  return OwnResidentBytes(pid_) + channel_->in().resident_bytes();
}

uint64_t WorkerProcess::TakenBytes() {
  const uint64_t resident = ResidentBytes();
  base_resident_ = std::min(base_resident_, resident);  // it may not have freed its last mesh completely
  return resident - base_resident_;
}

absl::Status WorkerProcess::ChargeMore(uint64_t bytes, MemoryCharge& charge) {
  constexpr std::string_view kWhat = "loading the mesh";
  absl::Status full = charge.GrowNow(bytes, kWhat);
  if (full.ok() || !IsInUseByOthers(full)) return full;
  kill(pid_, SIGSTOP);
  full = charge.Grow(bytes, kWhat);
  kill(pid_, SIGCONT);
  return full;
}

absl::Status WorkerProcess::WaitForAnswer(uint64_t memory_bytes, const JobContext& job, MemoryCharge& charge,
                                          Message& answer) {
  const uint64_t most_bytes = memory_bytes == 0 ? SharedRegion::kBytes / 2 : memory_bytes + kSlackBytes;
  absl::Status over;
  Clock::time_point kill_at;
  // A process that was killed while it was idle takes its time to close its socket, and messages still arrive there.
  const bool was_ending = IsEnding(pid_);
  while (true) {
    absl::StatusOr<Message> message = channel_->Receive(kLookInterval, most_bytes);
    if (message.ok()) {
      if (message->kind != MessageKind::kAnswer || message->number != number_) {
        Kill("protocol");
        return absl::InternalError("the process that loaded the mesh returned an unexpected answer");
      }
      answer = *std::move(message);
      return over;
    }
    if (absl::IsUnavailable(message.status()) || absl::IsAborted(message.status())) {
      const absl::Status died = Died(was_ending && absl::IsAborted(message.status()));
      return over.ok() ? died : over;
    }
    if (!absl::IsDeadlineExceeded(message.status())) {
      Kill("protocol");
      return message.status();
    }
    const Clock::time_point now = Clock::now();
    if (over.ok()) {
      over = job.Check();
      if (!over.ok()) {
        kill_at = now + kPatience;
        sigval number{};
        number.sival_int = int(number_ & 0x7fffffff);
        sigqueue(pid_, kCancelSignal, number);
      }
    } else if (now >= kill_at) {
      Kill(absl::IsCancelled(over) ? "cancelled" : "deadline");
      return over;
    }
    // From here on charged to the server's budget, and limited by it.
    const uint64_t taken = TakenBytes();
    absl::Status full;
    if (taken > charge.bytes()) full = ChargeMore(taken - charge.bytes(), charge);
    if (full.ok() && memory_bytes > 0 && taken > memory_bytes + kSlackBytes) {
      full = MakeLimitError(absl::StrCat("loading the mesh takes more than ", memory_bytes, " bytes of memory"),
                            {taken, memory_bytes, 0});
    }
    if (!full.ok()) {
      if (over.ok()) over = job.Check();  // it may have ended during the wait
      if (over.ok()) over = full;
      Kill(absl::IsCancelled(over) ? "cancelled" : absl::IsDeadlineExceeded(over) ? "deadline" : "memory");
      return over;
    }
  }
}

absl::Status WorkerProcess::Ask(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question,
                                const JobContext& job, const std::function<absl::Status(ArchiveReader&)>& read,
                                MemoryCharge& kept) {
  if (absl::Status s = WaitUntilReady(job); !s.ok()) return s;
  // Only now: while the last answer was read, the process still held its mesh.
  if (std::exchange(measure_, false)) base_resident_ = ResidentBytes();
  const Clock::time_point begin = Clock::now();
  absl::Status status = Exchange(kind, memory_bytes, question, job, read, kept);
  measure_ = Clock::now() - begin >= kLookInterval;
  // Large meshes leave much free memory behind.
  if (usable() && (channel_->in().resident_bytes() > options_.kept_bytes ||
                   channel_->out().resident_bytes() > options_.kept_bytes)) {
    channel_->in().ShrinkTo(options_.kept_bytes);
    channel_->out().ShrinkTo(options_.kept_bytes);
  }
  return status;
}

absl::Status WorkerProcess::Exchange(MessageKind kind, uint64_t memory_bytes, const ArchiveWriter& question,
                                     const JobContext& job, const std::function<absl::Status(ArchiveReader&)>& read,
                                     MemoryCharge& kept) {
  BoundProcess(pid_,
               memory_bytes == 0 ? 0 : base_space_ + memory_bytes + options_.kept_bytes + 2 * question.bulk_bytes(),
               kMaxCpuSeconds);
  if (absl::Status s = channel_->Send(kind, ++number_, question); !s.ok()) {
    return absl::IsUnavailable(s) ? Died(true) : s;
  }
  Message answer;
  MemoryCharge charge(&MemoryOf(job));  // of the memory of the process, then of the result
  if (absl::Status s = WaitForAnswer(memory_bytes, job, charge, answer); !s.ok()) return s;
  const uint64_t came_bytes = answer.text.size() + answer.bulk.size();
  charge.ShrinkTo(came_bytes);
  if (absl::Status s = charge.Grow(came_bytes - charge.bytes(), "the loaded mesh, as it came"); !s.ok()) return s;
  MemoryCharge read_charge(&MemoryOf(job));
  if (absl::Status s = read_charge.Grow(came_bytes, "the loaded mesh"); !s.ok()) return s;
  ArchiveReader reader(answer.text, answer.bulk);
  absl::Status status;
  Fields(reader, status);
  const absl::Status taken = status.ok() ? read(reader) : reader.Finish();
  if (absl::IsInternal(taken)) Kill("protocol");
  if (!taken.ok()) status = taken;
  if (status.ok()) kept = std::move(read_charge);
  return status;
}

void WorkerProcess::Trim() {
  if (!usable() || !ready_) return;
  channel_->in().ShrinkTo(0);
  channel_->out().ShrinkTo(0);
  if (!channel_->Send(MessageKind::kTrim, 0, {}).ok()) Kill("died");
}

}  // namespace voxelpipe
