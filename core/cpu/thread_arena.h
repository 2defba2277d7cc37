// oneTBB arenas that last as long as the thread that works in them.
#pragma once

#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <map>

namespace voxelpipe::cpu {

// The calling thread's own arena of `threads` (0, or more than there are cores: one a core). Kept until the thread ends: making an arena
// for every run costs as much as a small run. Valid for this thread only.
inline tbb::task_arena& ThreadArena(int threads) {
  // More threads than cores only wait for each other.
  const int cores = tbb::info::default_concurrency();
  const int size = threads > 0 ? std::min(threads, cores) : cores;
  // One a size: a run inside another one must not end the arena that it is in.
  static thread_local std::map<int, tbb::task_arena> arenas;
  return arenas.try_emplace(size, size).first->second;
}

}  // namespace voxelpipe::cpu
