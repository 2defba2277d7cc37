// Batches on the device against each of their items alone on the CPU.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gpu/parity_cases.h"
#include "pipeline/batch.h"

namespace voxelpipe::gpu {

class BatchParity {
 public:
  // Batches of at most so many items, run on `device`.
  BatchParity(const Backend& device, size_t most) : device_(device), most_(most) {}

  // Adds those of the cases that make sense in a batch: every one of plain bits, and of the others each `every`-th.
  void Add(const std::string& name, std::shared_ptr<const TriangleMesh> mesh, const std::vector<ParityCase>& cases,
           size_t every);
  // Runs what is waiting.
  void Flush();

  // Prints the first differences as they are found, and one line at the end.
  uint64_t differ() const { return differ_; }
  uint64_t cases() const { return cases_; }
  void Report() const;

 private:
  struct Item {
    std::string line;
    std::shared_ptr<const TriangleMesh> mesh;
    VoxelizeRequest request;
  };

  const Backend& device_;
  const size_t most_;
  std::vector<Item> waiting_;
  uint64_t cases_ = 0, differ_ = 0, batches_ = 0, shared_ = 0, passes_ = 0, launches_ = 0;
};

}  // namespace voxelpipe::gpu
