#include "gpu/cases/parity_options.h"

#include <algorithm>
#include <cstdlib>

namespace voxelpipe::gpu {

bool ParseParityOptions(int argc, char** argv, ParityOptions& options) {
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const char* value = i + 1 < argc ? argv[i + 1] : nullptr;
    if (argument == "--quick") {
      options.quick = true;
    } else if (argument == "--batches") {
      options.batches = true;
    } else if (argument == "--bench-meshes") {
      options.bench_meshes = true;
    } else if (argument == "--paths") {
      options.paths = true;
    } else if (argument == "--span-limits") {
      options.span_limits = true;
    } else if (argument == "--list") {
      options.list = true;
    } else if (argument == "--self") {
      options.self = true;
    } else if (argument == "--files") {
      options.files.assign(argv + i + 1, argv + argc);
      break;
    } else if (value == nullptr) {
      return false;
    } else if (argument == "--filter") {
      options.filter = argv[++i];
    } else if (argument == "--bunny") {
      options.bunny = argv[++i];
    } else if (argument == "--cache") {
      options.cache = std::strtoull(argv[++i], nullptr, 10);
    } else if (argument == "--every") {
      options.every = std::max(1u, uint32_t(std::atoi(argv[++i])));
    } else if (argument == "--seed") {
      options.seed = uint32_t(std::atoi(argv[++i]));
    } else if (argument == "--budget") {
      options.budget_s = std::atof(argv[++i]);
    } else {
      return false;
    }
  }
  return true;
}

}  // namespace voxelpipe::gpu
