// The sandbox: what a process gives up before it reads untrusted input.
#pragma once

#include <cstdint>

#include "absl/status/status.h"

namespace voxelpipe {

// After this call all threads of this process can use memory, threads, clocks and open descriptors, and exit; the
// kernel refuses everything else with EPERM: opening files or sockets, starting programs, accessing other processes,
// executable memory. Seccomp with PR_SET_NO_NEW_PRIVS: needs no privilege. Cannot be undone. Errors: UNAVAILABLE if the
// kernel or the container does not allow it.
absl::Status EnterSandbox();

// Ends the process with its parent, leaves SIGINT, SIGTERM and SIGHUP to the parent, disables core files.
void BindToParent();

// True if another process of this user has ended or has been killed, although its descriptors may be open still.
bool IsEnding(int pid);

// Bytes of address space of another process of this user. 0: it has ended.
uint64_t AddressSpaceBytes(int pid);
// Its resident bytes, without shared ones.
uint64_t OwnResidentBytes(int pid);

// Limits another process of this user: its address space (0: no limit), and its further CPU time in seconds.
void BoundProcess(int pid, uint64_t address_space_bytes, uint64_t cpu_seconds);

// True if this build has a sanitizer, which needs terabytes of address space.
bool IsSanitizedBuild();

}  // namespace voxelpipe
