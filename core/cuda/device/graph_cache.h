// Launches recurring lists of kernels as CUDA graphs: one host call for the list instead of about 4 us per kernel.
//
// The first time, a list is launched kernel by kernel. When a list like it recurs (the same kernels and grid sizes) it
// becomes a graph, whose arguments are updated for every further list like it. Graphs stay cached per device between
// runs.
#pragma once

#include <cuda_runtime_api.h>

#include <list>
#include <memory>

#include "absl/status/status.h"

namespace voxelpipe::cuda {

class LaunchList;
class LaunchGraph;

// The graphs that one run holds exclusively.
class LaunchGraphs {
 public:
  LaunchGraphs();
  LaunchGraphs(const LaunchGraphs&) = delete;
  LaunchGraphs& operator=(const LaunchGraphs&) = delete;
  ~LaunchGraphs();  // returns them to the cache

  // Launches the list on `stream` of the device, which must be current. Kernels are launched one by one if the list
  // starts with a programmatic dependent launch, since a graph starts only when all work before it has ended, or if the
  // device refuses the graph. Errors: those of a launch.
  absl::Status Launch(const LaunchList& list, int ordinal, cudaStream_t stream);

 private:
  LaunchGraph* Find(const LaunchList& list, int ordinal);

  int ordinal_ = 0;
  std::list<std::unique_ptr<LaunchGraph>> mine_;  // most recent first
};

// Destroys the graphs of the current device that no run holds, and forgets the lists seen.
void DropLaunchGraphs(int ordinal);

}  // namespace voxelpipe::cuda
