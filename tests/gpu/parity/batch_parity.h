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

  // Adds those of the cases that make sense in a batch: every one of plain bits, and of the others each `every`-th.
  void Add(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh,
           const std::vector<ParityCase>& cases, size_t every);
  // Adds A-buffers of all kinds of a mesh about [0, 40].
  void AddABuffers(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh);
  // The same of flood fills, each second one from `first` on.
  void AddFloods(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh, size_t first);
  // Runs what is waiting.
  void Flush();
  // The same, A-buffers of empty meshes and flood fills of all kinds of meshes among it; and then whether a pass of
  // many A-buffers or flood fills takes as many launches as one of few.
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
    std::optional<bool> shares;  // a pass; none: whatever it does
  };

  void Add(std::string line, std::shared_ptr<const TriangleMesh> mesh, const VoxelizeRequest& request,
           std::optional<bool> shares = std::nullopt);
  void Differ(const std::string& line, const std::string& how);
  void CheckLaunches();
  // Whether the device shares passes at all; whether it has so little memory that many take several.
  bool Shares() const { return device_.name() == "cuda"; }
  bool IsShort() const { return device_.memory_bytes() < uint64_t{1} << 30; }

  const Backend& device_;
  const size_t most_;
  std::vector<Item> waiting_;
  uint64_t cases_ = 0, differ_ = 0, batches_ = 0, shared_ = 0, passes_ = 0, launches_ = 0;
  uint64_t a_buffers_ = 0, shared_a_buffers_ = 0, floods_ = 0, shared_floods_ = 0;  // results
};

}  // namespace voxelpipe::gpu
