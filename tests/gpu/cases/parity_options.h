// The options of cuda_parity; cuda_parity.cpp describes them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace voxelpipe::gpu {

struct ParityOptions {
  bool quick = false, batches = false, bench_meshes = false, list = false, self = false, span_limits = false;
  bool paths = false;
  std::string filter, bunny;
  std::vector<std::string> files;
  uint64_t cache = 0;  // bytes; 0: that of the device
  uint32_t every = 1;  // every so many cases of a mesh one is run, and no batches if not all are
  uint32_t seed = 1;
  double budget_s = 1e9;
};

// False for an unknown option, or one without its value.
bool ParseParityOptions(int argc, char** argv, ParityOptions& options);

}  // namespace voxelpipe::gpu
