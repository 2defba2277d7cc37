// The fuzz target: libFuzzer's entry, which fuzz_main.cpp calls as well.
#include <cstdio>
#include <cstdlib>

#include "fuzz/fuzz_checks.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string wrong = voxelpipe::fuzz::CheckCase(voxelpipe::fuzz::MakeCase({data, size}));
  if (!wrong.empty()) {
    std::fprintf(stderr, "%s", wrong.c_str());
    std::abort();
  }
  return 0;
}
