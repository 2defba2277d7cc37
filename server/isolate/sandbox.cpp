// Source: seccomp_rule_add(3), seccomp(2); the allowed calls are those that glibc 2.36, its allocator and oneTBB make.
#include "isolate/sandbox.h"

#include <errno.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

// System calls that are harmless with all arguments: memory, threads of this process, clocks, open descriptors, exit.
constexpr int kAllowed[] = {SCMP_SYS(brk),
                            SCMP_SYS(munmap),
                            SCMP_SYS(mremap),
                            SCMP_SYS(madvise),
                            SCMP_SYS(futex),
                            SCMP_SYS(set_robust_list),
                            SCMP_SYS(rseq),
                            SCMP_SYS(exit),
                            SCMP_SYS(exit_group),
                            SCMP_SYS(rt_sigreturn),
                            SCMP_SYS(rt_sigprocmask),
                            SCMP_SYS(sigaltstack),
                            SCMP_SYS(restart_syscall),
                            SCMP_SYS(sched_yield),
                            SCMP_SYS(sched_getaffinity),
                            SCMP_SYS(gettid),
                            SCMP_SYS(getpid),
                            SCMP_SYS(clock_gettime),
                            SCMP_SYS(clock_nanosleep),
                            SCMP_SYS(nanosleep),
                            SCMP_SYS(getrandom),
                            SCMP_SYS(read),
                            SCMP_SYS(write),
                            SCMP_SYS(poll),
                            SCMP_SYS(ppoll),
                            SCMP_SYS(sendto),
                            SCMP_SYS(recvfrom),
                            SCMP_SYS(close),
                            SCMP_SYS(getrusage)};

// A thread of this process has at least these of clone(2).
constexpr uint64_t kThreadFlags = CLONE_VM | CLONE_FS | CLONE_FILES | CLONE_SIGHAND | CLONE_THREAD;
// And none of these.
constexpr uint64_t kNamespaceFlags = CLONE_NEWNS | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER | CLONE_NEWPID |
                                     CLONE_NEWNET | CLONE_NEWCGROUP | CLONE_VFORK | CLONE_PTRACE;

int AddRules(scmp_filter_ctx filter) {
  for (const int call : kAllowed) {
    if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); error != 0) return error;
  }
  // UndefinedBehaviorSanitizer asks whether an address can be read by writing from it into a pipe of its own.
  if (IsSanitizedBuild()) {
    for (const int call : {SCMP_SYS(pipe), SCMP_SYS(pipe2)}) {
      if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); error != 0) return error;
    }
  }
  // No executable memory.
  const scmp_arg_cmp not_executable = SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0);
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)}) {
    if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 1, not_executable); error != 0) return error;
  }
  const scmp_arg_cmp thread = SCMP_A0(SCMP_CMP_MASKED_EQ, kThreadFlags | kNamespaceFlags, kThreadFlags);
  if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1, thread); error != 0) return error;
  // Its flags are in memory, which a filter cannot read; after the error glibc calls clone.
  if (const int error = seccomp_rule_add(filter, SCMP_ACT_ERRNO(ENOSYS), SCMP_SYS(clone3), 0); error != 0) return error;
  // abort() sends a signal to this process itself.
  const scmp_arg_cmp self = SCMP_A0(SCMP_CMP_EQ, uint64_t(getpid()), 0);
  if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, self); error != 0) return error;
  // abort() restores the default action.
  return seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(rt_sigaction), 0);
}

// A figure of /proc/PID/statm, in pages.
struct Statm {
  uint64_t size = 0, resident = 0, shared = 0;
};

Statm ReadStatm(int pid) {
  Statm statm;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(
      std::fopen(absl::StrCat("/proc/", pid, "/statm").c_str(), "re"), std::fclose);
  unsigned long size = 0, resident = 0, shared = 0;  // NOLINT(google-runtime-int): scanf's types
  if (file && std::fscanf(file.get(), "%lu %lu %lu", &size, &resident, &shared) == 3) statm = {size, resident, shared};
  return statm;
}

// Keeps the hard limit, which an unprivileged process cannot raise again.
void SetSoftLimit(int pid, __rlimit_resource resource, rlim_t value) {
  rlimit limit{};
  if (prlimit(pid, resource, nullptr, &limit) != 0) return;
  limit.rlim_cur = std::min(value, limit.rlim_max);
  prlimit(pid, resource, &limit, nullptr);
}

uint64_t PageBytes() {
  static const uint64_t bytes = uint64_t(sysconf(_SC_PAGESIZE));
  return bytes;
}

}  // namespace

absl::Status EnterSandbox() {
  const std::unique_ptr<void, void (*)(scmp_filter_ctx)> filter(seccomp_init(SCMP_ACT_ERRNO(EPERM)), seccomp_release);
  if (filter == nullptr) return absl::UnavailableError("no seccomp filter: out of memory");
  int error = AddRules(filter.get());
  // Existing threads are restricted as well. PR_SET_NO_NEW_PRIVS is the library's default.
  if (error == 0) error = seccomp_attr_set(filter.get(), SCMP_FLTATR_CTL_TSYNC, 1);
  if (error == 0) error = seccomp_load(filter.get());
  if (error == 0) return absl::OkStatus();
  return absl::UnavailableError(absl::ErrnoToStatus(-error, "seccomp").message());
}

void BindToParent() {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) std::signal(signal, SIG_IGN);
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
}

bool IsEnding(int pid) {
  constexpr std::string_view kMemory = "VmSize:", kPending[] = {"SigPnd:", "ShdPnd:"};
  std::ifstream file(absl::StrCat("/proc/", pid, "/status"));
  bool has_memory = false;
  for (std::string line; std::getline(file, line);) {
    has_memory = has_memory || line.starts_with(kMemory);
    for (const std::string_view pending : kPending) {
      if (!line.starts_with(pending)) continue;
      const uint64_t signals = std::strtoull(line.c_str() + pending.size(), nullptr, 16);
      if ((signals >> (SIGKILL - 1) & 1) != 0) return true;
    }
  }
  return !has_memory;
}

uint64_t AddressSpaceBytes(int pid) {
  return ReadStatm(pid).size * PageBytes();
}

uint64_t OwnResidentBytes(int pid) {
  const Statm statm = ReadStatm(pid);
  return (statm.resident - std::min(statm.resident, statm.shared)) * PageBytes();
}

void BoundProcess(int pid, uint64_t address_space_bytes, uint64_t cpu_seconds) {
  SetSoftLimit(pid, RLIMIT_AS, address_space_bytes > 0 && !IsSanitizedBuild() ? address_space_bytes : RLIM_INFINITY);
  clockid_t clock = 0;
  timespec used{};
  if (clock_getcpuclockid(pid, &clock) != 0 || clock_gettime(clock, &used) != 0) return;
  SetSoftLimit(pid, RLIMIT_CPU, rlim_t(used.tv_sec) + 1 + cpu_seconds);
}

bool IsSanitizedBuild() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
  return true;
#else
  return false;
#endif
#else
  return false;
#endif
}

}  // namespace voxelpipe
