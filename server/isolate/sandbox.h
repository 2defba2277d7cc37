// The sandbox: what a process gives up before it reads untrusted input.
#pragma once

#include <cstdint>

#include "absl/status/status.h"

namespace voxelpipe {

// From here on this process, all of its threads, can use memory, threads, clocks and the descriptors that it has, and
// end; the kernel refuses all else with EPERM: it opens no file and no socket, starts no program, sees no other
// process, makes no memory executable. Seccomp with PR_SET_NO_NEW_PRIVS: needs no privilege. Cannot be undone.
// Errors: UNAVAILABLE where the kernel or what the process runs in does not let it.
absl::Status EnterSandbox();

// Takes the process down with its parent, leaves SIGINT, SIGTERM and SIGHUP to that, writes no core files.
void BindToParent();

// Bytes of address space that another process of this user has now. 0: it is gone.
uint64_t AddressSpaceBytes(int pid);
// Its resident bytes, without what it shares.
uint64_t OwnResidentBytes(int pid);

// Bounds another process of this user: what it may have of address space (0: no bound), and how many seconds of
// processor time it may take from now on.
void BoundProcess(int pid, uint64_t address_space_bytes, uint64_t cpu_seconds);

// True if this build carries a sanitizer, which needs terabytes of address space.
bool IsSanitizedBuild();

}  // namespace voxelpipe
