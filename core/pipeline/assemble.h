// Puts the slabs of a run together: into one result in memory, or into a sink in stream order.
#pragma once

#include <vector>

#include "absl/status/status.h"
#include "job/request.h"
#include "job/result.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// Begin; then, for each pass, Add once a slab by ascending z; then End.
class Assembler {
 public:
  virtual ~Assembler() = default;
  // `parts` outlives the assembler's work. Its counts are there with the last slab of the first pass.
  virtual absl::Status Begin(const VoxelizeRequest& request, const Plan& plan, const PartTable& parts) = 0;
  // How often all slabs are to be made. Known after Begin.
  virtual int passes() const { return 1; }
  virtual absl::Status Add(int pass, const Slab& slab, ResultArrays arrays) = 0;
  // The most that End takes beside what was added.
  virtual uint64_t bytes_to_join() const { return 0; }
  virtual absl::Status End() { return absl::OkStatus(); }
};

// One result in memory. A single slab is taken as it is; dense slabs are copied to their place; the lists of sparse and
// bucketed slabs are joined at the end.
class MemoryAssembler final : public Assembler {
 public:
  absl::Status Begin(const VoxelizeRequest& request, const Plan& plan, const PartTable& parts) override;
  absl::Status Add(int pass, const Slab& slab, ResultArrays arrays) override;
  uint64_t bytes_to_join() const override;
  absl::Status End() override;
  VoxelizeResult Take() { return std::move(result_); }

 private:
  VoxelizeResult result_;
  const PartTable* parts_ = nullptr;
  bool one_slab_ = true;
  std::vector<ResultArrays> slabs_;  // sparse and buckets
};

// Dense slabs into a sink. One pass a target; one a plane of a planar target, whose planes follow each other in stream
// order. The table of parts comes last.
class StreamAssembler final : public Assembler {
 public:
  explicit StreamAssembler(ResultSink& sink) : sink_(sink) {}
  absl::Status Begin(const VoxelizeRequest& request, const Plan& plan, const PartTable& parts) override;
  int passes() const override { return int(passes_.size()); }
  absl::Status Add(int pass, const Slab& slab, ResultArrays arrays) override;
  absl::Status End() override;

 private:
  struct Pass {
    size_t target;
    int plane, planes;  // the part of the target's array that this pass hands on
  };

  ResultSink& sink_;
  const PartTable* parts_ = nullptr;
  bool kept_ = false;  // by the sink, as a whole
  std::vector<Pass> passes_;
  ResultHeader header_;
  std::vector<Pass> all_at_once_;  // where one slab is the whole grid: what its only pass hands on
};

}  // namespace voxelpipe
