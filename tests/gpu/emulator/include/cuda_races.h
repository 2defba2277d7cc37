// Finds unordered accesses of a kernel's threads to the same memory, whatever order they had in this run. Part of
// cuda_parity_races: its kernels are compiled with -fsanitize=thread; the calls before each access are implemented here
// instead of in that sanitizer's library.
//
// The happens-before order, after C. Flanagan and S. Freund, "FastTrack", PLDI 2009, with the clocks that a block's
// structure gives for free:
// * the accesses of a thread, one after the other;
// * accesses of threads of a block before and after a barrier, and of lanes of a warp before and after __syncwarp
//   (shuffles and votes order nothing);
// * accesses that a thread made, or was ordered after, before a fence, for a thread that reads its later atomic or
//   volatile write. The reader needs no fence: only dependent accesses are expected to follow;
// * kernels of a stream. One that starts by programmatic dependent launch is ordered after the previous kernel only
//   behind AwaitEarlier(), or by such fences; of the kernels before that, it is ordered after everything that every
//   thread of the previous kernel was ordered after when it called AllowNext() or ended.
// Atomics, volatile accesses and loads with a cache operator (__ldcg and the like) do not race with each other. Shared
// memory is that of a block.
//
// Reports go to stderr, a line each, when the program ends, with exit status 9. Concurrent runs of several host threads
// on streams of their own count as one stream.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cuda_emulator::races {

#ifdef CUDA_EMULATOR_RACES

void BeginKernel(bool early);
// `shared`: the dynamic shared memory of the block.
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

// The number of race locations found since the last call, which are then not reported at the end of the program.
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
