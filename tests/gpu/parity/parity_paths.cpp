#include "gpu/parity/parity_paths.h"

#include <cstdio>
#include <vector>

namespace voxelpipe::gpu {

bool PrintPaths(const std::map<std::string, uint64_t>& paths, const ParityOptions& options) {
  for (const auto& [path, count] : paths)
    std::printf("path %s: %llu\n", path.c_str(), static_cast<unsigned long long>(count));
  const bool all_cases = options.filter.empty() && options.every == 1;
  if (options.self || options.bench_meshes || !(all_cases || options.paths)) return true;
  std::vector<std::string> wanted = {"nothing", "occupancy", "fragment list"};
  for (const char* path :
       {"triangles in place", "triangles in place, by records", "triangles in bricks", "triangles in accumulators",
        "owners in bricks", "owners in accumulators", "fragments in accumulators"}) {
    wanted.push_back(path);
  }
  for (const char* path : {"nothing", "coverage", "triangles in accumulators", "triangles in place, by records",
                           "owners in accumulators", "fragments in accumulators"}) {
    wanted.push_back(std::string(path) + ", by parts");
  }
  if (options.cache > 0 && all_cases) wanted.push_back("triangles in place, float4");  // of fine meshes
  bool all = true;
  for (const std::string& path : wanted) {
    if (paths.count(path) > 0) continue;
    all = false;
    std::printf("path %s: never ran\n", path.c_str());
  }
  return all;
}

}  // namespace voxelpipe::gpu
