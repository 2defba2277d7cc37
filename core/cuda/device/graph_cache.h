// Lists of kernels that come again go to the device as CUDA graphs: one call of the host's for all of them, in place of
// some 4 us for each.
//
// A list goes kernel by kernel when it comes for the first time. When one like it comes again - the same kernels, of as
// many blocks - it is made into a graph, which then takes the arguments of each list that is like it. Graphs are kept
// on their device between runs.
#pragma once

#include <cuda_runtime_api.h>

#include <list>
#include <memory>

#include "absl/status/status.h"

namespace voxelpipe::cuda {

class LaunchList;
class LaunchGraph;

// Those that a run uses, which no other run does meanwhile.
class LaunchGraphs {
 public:
  LaunchGraphs();
  LaunchGraphs(const LaunchGraphs&) = delete;
  LaunchGraphs& operator=(const LaunchGraphs&) = delete;
  ~LaunchGraphs();  // keeps them for others

  // Gives the list to `stream` of the device, which is the current one. A list that begins early goes kernel by kernel,
  // since a graph begins when all before it has ended; so does one whose graph the device refuses. Errors: what a
  // launch refuses.
  absl::Status Launch(const LaunchList& list, int ordinal, cudaStream_t stream);

 private:
  LaunchGraph* Find(const LaunchList& list, int ordinal);

  int ordinal_ = 0;
  std::list<std::unique_ptr<LaunchGraph>> mine_;  // the latest first
};

// Destroys the graphs of a device that no run uses, which is the current one, and forgets which lists came.
void DropLaunchGraphs(int ordinal);

}  // namespace voxelpipe::cuda
