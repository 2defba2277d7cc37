// Finds accesses of a kernel's threads to the same memory that nothing puts in order, whatever order they had in this
// run. What cuda_parity_races has besides the emulator: its kernels are compiled with -fsanitize=thread, whose calls
// before each access are answered here instead of by that sanitizer's library.
//
// In order are, after C. Flanagan and S. Freund, "FastTrack", PLDI 2009, with the clocks that a block's structure gives
// for nothing:
// * what a thread does, one after the other;
// * what threads of a block do before and behind a barrier, and lanes of a warp before and behind __syncwarp (shuffles
// and votes order nothing);
// * what a thread did, or had seen, before a fence, for a thread that sees what it then writes by an atomic or as volatile.
// The one who sees it needs
//   no fence here: only what depends on it is expected to follow;
// * kernels of a stream; but one that begins early knows the one before it only behind AwaitEarlier(), or by such
// fences, and of those before that
//   what every thread of the one before knew when it called AllowNext() or ended.
// Atomics, volatile accesses and loads that say where they look (__ldcg and the like) are no race among themselves.
// Shared memory is a block's.
//
// What it tells goes to stderr, a line each, when the program ends, whose exit status is 9 then. Runs of several host
// threads at a time on streams of their own are taken for one stream.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cuda_emulator::races {

#ifdef CUDA_EMULATOR_RACES

void BeginKernel(bool early);
// `shared`: what the block has besides static memory.
void BeginBlock(uint32_t block, unsigned threads, const void* shared, size_t shared_bytes);
void SwitchTo(unsigned thread, const void* stack, size_t stack_bytes);
void EndBlock();
void Barrier();                                // of the block
void JoinWarp(unsigned warp, uint32_t lanes);  // that came to one __syncwarp

// Of the running thread.
void Fence();
void Relaxed(const void* at, size_t bytes, bool writes, const void* code);  // from `code` on
void AwaitEarlier();
void AllowNext();

// How many places of races were found since the last call, which the program's end does not tell of then.
size_t Forget();

#else

inline void BeginKernel(bool) {}
inline void BeginBlock(uint32_t, unsigned, const void*, size_t) {}
inline void SwitchTo(unsigned, const void*, size_t) {}
inline void EndBlock() {}
inline void Barrier() {}
inline void JoinWarp(unsigned, uint32_t) {}
inline void Fence() {}
inline void Relaxed(const void*, size_t, bool, const void*) {}
inline void AwaitEarlier() {}
inline void AllowNext() {}

#endif

}  // namespace cuda_emulator::races
