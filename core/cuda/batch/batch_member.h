// An item of a batch that shares a pass with others: what is known of it before the pass.
#pragma once

#include <memory>

#include "cpu/run_state.h"
#include "pipeline/batch.h"
#include "pipeline/planner.h"
#include "pipeline/stages/bind.h"

namespace voxelpipe::cuda {

// How a member goes through a pass.
enum class BatchPath {
  kRows,       // plain bits
  kValues,     // other dense and sparse results
  kFragments,  // A-buffers
};

struct BatchMember {
  const BatchItem* item = nullptr;
  std::unique_ptr<BoundRequest> bound;
  std::unique_ptr<cpu::RunState> host;  // refers to `bound`; its view shows the mesh as the vertex shader left it
  Plan plan;
  VoxelizeStats stats;
  BatchPath path = BatchPath::kRows;
  uint64_t box_voxels = 0;  // unless its path is kRows: about the most fragments that it can have

  const VoxelizeRequest& request() const { return bound->request; }
  uint64_t triangles() const { return host->view.triangle_count; }
  uint64_t vertices() const { return host->view.vertex_count; }
  uint64_t rows() const { return uint64_t(plan.grid.dims[1]) * uint64_t(plan.grid.dims[2]); }
  uint64_t words() const { return rows() * uint64_t((plan.grid.dims[0] + 31) / 32); }  // of a bit grid
  uint64_t packed_words() const { return (plan.grid.voxels() + 31) / 32; }             // of one target
  bool sparse() const { return request().result == ResultKind::kSparse; }
  bool parity() const { return request().fill == Fill::kParity; }
  bool flood() const { return request().fill == Fill::kFlood; }
  bool filled() const { return request().fill != Fill::kNone; }
  // Whether a flood's conservative shell is rasterized besides the coverage, which is not it.
  bool own_shell() const;
  // A pass has its members in this order: by path, and those that are flooded, and of them those with a shell of their
  // own, next to each other.
  int order() const;
  uint64_t column_words() const {  // of all layers
    return parity() ? uint64_t((plan.grid.dims[1] + 31) / 32) * uint64_t(plan.grid.dims[2]) : 0;
  }
  // The stage that its pass is to clients, all that it does.
  const char* stage() const { return path == BatchPath::kFragments ? "emit" : "fine_raster"; }
  // What the device holds of its bit grids, in 32-bit words; not of an A-buffer.
  uint64_t grid_words() const;
  // What the device holds of its targets, packed bits and values, in 32-bit words; not of an A-buffer.
  uint64_t target_words() const;
  // About the most that fragments take on the device, in 32-bit words: of an A-buffer what goes back, of values their
  // list and accumulators.
  uint64_t fragment_words() const;
};

// Shades the item's vertices and plans. Null where it cannot share a pass, being large, of another kind, or wrong in
// some way: alone it says what. In the calling thread's arena.
std::unique_ptr<BatchMember> PrepareMember(const Backend& backend, const BatchItem& item, const PlanLimits& limits);

}  // namespace voxelpipe::cuda
