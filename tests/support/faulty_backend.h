// A device that fails on demand.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "pipeline/stages/stages.h"

namespace voxelpipe::testing {

// The fault to inject from now on.
struct Fault {
  std::string kind;   // error, lost, memory (device failures), throw (an exception), stall; empty: nothing
  std::string stage;  // where: start, vertex_shade, coarse_raster, tile_sort, begin_slab, fine_raster, emit, finish
  int runs = 1;       // number of affected runs, from the next one on; -1: all
  int slab = 0;       // for stages of slabs: the slab, counted from 0
  int probes = 0;     // number of failing probes
  std::string probe;  // "stall": they do not end, while the fault is set

  friend bool operator==(const Fault&, const Fault&) = default;
};

// "kind=lost stage=fine_raster runs=1 probes=2", keys in any order, unknown ones ignored.
Fault ParseFault(const std::string& text);

// The CPU backend under the name of a GPU. Thread-safe. A stalled run or probe continues when the fault is set again.
class FaultyBackend final : public Backend {
 public:
  // `control_file`: read before every run and probe; sets the fault whenever its contents have changed. Empty: none.
  explicit FaultyBackend(std::string device = "cuda:0", std::string control_file = "");

  void Set(const Fault& fault);
  // Started runs, including failed ones.
  int runs() const;

  std::string_view name() const override { return "cuda"; }
  std::string device() const override { return device_; }
  std::string model() const override { return "a device that breaks on demand"; }
  uint64_t memory_bytes() const override { return uint64_t{1} << 30; }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override;
  absl::Status Probe() const override;
  std::string_view simd() const override;
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override;
  void Run(int threads, const std::function<void()>& body) const override;
  void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const override;

 private:
  class FaultyStages;

  void ReadControlFile() const;
  // Blocks until another fault is set.
  void Stall() const;

  const std::string device_, control_file_;
  mutable std::mutex mutex_;
  mutable Fault fault_;
  mutable std::string control_text_;
  mutable uint64_t changes_ = 0;
  mutable int runs_ = 0;
};

}  // namespace voxelpipe::testing
