// An item of a batch that can share a pass with others: everything that is known before the pass.
#pragma once

#include <memory>

#include "host_mesh/host_mesh.h"
#include "pipeline/batch.h"
#include "pipeline/planner.h"
#include "pipeline/stages/bind.h"

namespace voxelpipe::cuda {

// How a pass processes a member.
enum class BatchPath {
  kRows,       // occupancy bits
  kValues,     // other dense and sparse results
  kFragments,  // A-buffers
};

struct BatchMember {
  const BatchItem* item = nullptr;
  std::unique_ptr<BoundRequest> bound;
  std::unique_ptr<HostMesh> host;  // refers to `bound`; its view shows the mesh after the vertex shader
  Plan plan;
  VoxelizeStats stats;
  BatchPath path = BatchPath::kRows;
  uint64_t box_voxels = 0;  // not for kRows: approximate upper bound of its fragments

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
  // True if a flood fill needs a conservative shell besides the coverage.
  bool own_shell() const;
  // Sort key of members within a pass: by path; members with flood fill are adjacent, and among them those with their
  // own shell.
  int order() const;
  uint64_t column_words() const {  // over all layers
    return parity() ? uint64_t((plan.grid.dims[1] + 31) / 32) * uint64_t(plan.grid.dims[2]) : 0;
  }
  // The stage reported to clients for the whole pass.
  const char* stage() const { return path == BatchPath::kFragments ? "emit" : "fine_raster"; }
  // 32-bit words of device memory for its bit grids. Not for an A-buffer.
  uint64_t grid_words() const;
  // 32-bit words of device memory for its targets, packed bits and values. Not for an A-buffer.
  uint64_t target_words() const;
  // Approximate upper bound of the device memory of its fragments, in 32-bit words: for an A-buffer its result, for
  // values their list and accumulators.
  uint64_t fragment_words() const;
};

// Shades the item's vertices and makes its plan. Null if it cannot share a pass because it is too large, unsupported or
// invalid: run alone it returns the error. Runs in the calling thread's arena.
std::unique_ptr<BatchMember> PrepareMember(const Backend& backend, const BatchItem& item, const PlanLimits& limits);

}  // namespace voxelpipe::cuda
