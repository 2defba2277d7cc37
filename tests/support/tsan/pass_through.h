// A function of a library with a word to ThreadSanitizer before or after it: the dynamic linker finds the one defined
// here first, and this one calls the library's.
#pragma once

#include <dlfcn.h>

#include <cstdio>
#include <cstdlib>

extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);

namespace voxelpipe::tsan {

// What this thread did until here is seen by a thread that calls Acquire with the same place afterwards.
template <typename T>
void Release(T place) {
  __tsan_release(reinterpret_cast<void*>(place));
}

template <typename T>
void Acquire(T place) {
  __tsan_acquire(reinterpret_cast<void*>(place));
}

// The library's function of this (mangled) name. Without one there is no way on: the process ends.
template <typename Function>
Function* Library(const char* symbol) {
  void* const found = dlsym(RTLD_NEXT, symbol);
  if (found == nullptr) {
    std::fprintf(stderr, "no library has the function %s\n", symbol);
    std::abort();
  }
  return reinterpret_cast<Function*>(found);
}

}  // namespace voxelpipe::tsan
