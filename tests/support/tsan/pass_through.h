// Interposes a library function with a ThreadSanitizer annotation before or after it: the dynamic linker finds the
// definition here first, which calls the library's.
#pragma once

#include <dlfcn.h>

#include <cstdio>
#include <cstdlib>

extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);

namespace voxelpipe::tsan {

// Release: earlier accesses of this thread happen before a later Acquire with the same address.
template <typename T>
void Release(T place) {
  __tsan_release(reinterpret_cast<void*>(place));
}

template <typename T>
void Acquire(T place) {
  __tsan_acquire(reinterpret_cast<void*>(place));
}

// The library's function of this (mangled) name. Ends the process if there is none.
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
