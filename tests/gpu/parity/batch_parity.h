// Batches on the device against each of their items alone on the CPU.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gpu/cases/parity_cases.h"
#include "pipeline/batch.h"

namespace voxelpipe::gpu {

class BatchParity {
 public:
  // Batches of at most so many items, run on `device`.
  BatchParity(const Backend& device, size_t most) : device_(device), most_(most) {}

  // Adds the cases that make sense in a batch: all of occupancy bits, and every `every`-th of the others.
  void Add(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh,
           const std::vector<ParityCase>& cases, size_t every);
  // Adds A-buffers of all kinds for a mesh about [0, 40].
  void AddABuffers(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh);
  // The same for flood fills, every second one from `first` on.
  void AddFloods(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh, size_t first);
  // Runs the waiting items.
  void Flush();
  // The same with A-buffers of empty meshes and flood fills of all kinds of meshes; then checks that a pass of many
  // A-buffers or flood fills has as many launches as a pass of few.
  void Finish();

  // Prints the first differences as they are found, and one line at the end.
  uint64_t differ() const { return differ_; }
  uint64_t cases() const { return cases_; }
  void Report() const;

 private:
  struct Item {
    std::string line;
    std::shared_ptr<const TriangleMesh> mesh;
    VoxelizeRequest request;
    std::optional<bool> shares;  // a pass; empty: either
  };

  void Add(std::string line, std::shared_ptr<const TriangleMesh> mesh, const VoxelizeRequest& request,
           std::optional<bool> shares = std::nullopt);
  void Differ(const std::string& line, const std::string& how);
  void CheckLaunches();
  // True if the device shares passes; true if its memory is so small that many take several passes.
  bool Shares() const { return device_.name() == "cuda"; }
  bool IsShort() const { return device_.memory_bytes() < uint64_t{1} << 30; }

  const Backend& device_;
  const size_t most_;
  std::vector<Item> waiting_;
  uint64_t cases_ = 0, differ_ = 0, batches_ = 0, shared_ = 0, passes_ = 0, launches_ = 0;
  uint64_t a_buffers_ = 0, shared_a_buffers_ = 0, floods_ = 0, shared_floods_ = 0;  // results
};

}  // namespace voxelpipe::gpu
