// Threads that run the jobs of callers and are kept for the next ones.
#pragma once

#include <functional>

namespace voxelpipe {

// Runs `work`, then `done`, on the thread that became idle last, or on a new one where all are busy, so that as many
// run at a time as callers wait. The thread is idle before `done` begins, so that a caller that `done` wakes gets the
// same thread again; `done` is short. Neither throws. A kept thread has its memory (the arena of malloc) and its place
// in oneTBB's scheduler from the call before: a new one maps and clears every page again. After a fork the child
// starts without threads.
void RunOnJobThread(std::function<void()> work, std::function<void()> done);

}  // namespace voxelpipe
