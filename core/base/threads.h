// Threads for parallel work (oneTBB's), one for each CPU that this process may use.
#pragma once

#include <cstddef>
#include <functional>

namespace voxelpipe {

// Calls `body` on the calling thread; parallel loops in it use at most `threads` threads, this one included. 0, or more
// than CpuCount(): one for each CPU.
void RunOnThreads(int threads, const std::function<void()>& body);

// Calls body(0) to body(count - 1) once each, in any order, on `count` threads at the same time. A thread that waits
// for a parallel loop of its body does not start another body meanwhile.
void RunEachOnThreads(int threads, size_t count, const std::function<void(size_t)>& body);

// Bounds the threads of all parallel loops of the process by CpuCount(): oneTBB itself ignores CPU quotas. Call it when
// the process starts, and after RefreshMachine. Thread-safe.
void LimitThreadsToCpus();

}  // namespace voxelpipe
