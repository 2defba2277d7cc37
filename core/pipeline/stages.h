// One run of the pipeline on one backend. pipeline/voxelize.cpp calls the stages in the paper's order; each backend
// decides who runs them when.
//
// Source: J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D Voxelization", HPG 2011, section 3 (the sort-middle
// blending pipeline). Changed: tiles are 32x8x8 voxels and coverage is taken as row spans.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "grid/host_buffer.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/request.h"
#include "shaders/catalog.h"

namespace voxelpipe {

// A request whose shaders are bound.
struct BoundRequest {
  VoxelizeRequest request;
  BoundShader vertex_shader;
  std::vector<BoundShader> fragment_shaders;  // one a target
};

// What the stages leave besides their targets.
struct StageCounts {
  uint64_t fragments = 0;
  uint64_t odd_columns = 0;
};

// Each stage is called once, in the order of declaration (SolidFill only with a fill). Every stage returns CANCELLED or
// DEADLINE_EXCEEDED as soon as it sees that the job should end, and RESOURCE_EXHAUSTED when memory is short.
class Stages {
 public:
  virtual ~Stages() = default;

  // Runs the vertex shader over every vertex. Out: the box of the shaded vertices that triangles use.
  // INVALID_ARGUMENT naming node, primitive and vertex where one of these is not finite.
  virtual absl::StatusOr<Box3d> VertexShade() = 0;

  // Allocates the targets for the fitted grid and sets every voxel to its clear value.
  virtual absl::Status ClearTargets(const GridSpec& grid) = 0;

  // Takes the vertices to index space and finds the tiles that each triangle may touch.
  // INVALID_ARGUMENT naming node, primitive and vertex for one beyond 2^40 voxels of the grid's origin.
  virtual absl::Status CoarseRaster() = 0;

  // Sorts (tile, triangle) pairs by tile, then by triangle id.
  virtual absl::Status TileSort() = 0;

  // For each occupied tile: row spans, fragment shading and blending in fast memory, store.
  virtual absl::Status FineRaster() = 0;

  // Fills the inside of the mesh where no fragment is.
  virtual absl::Status SolidFill() = 0;

  // Brings every target into its result format. One buffer a target.
  virtual absl::StatusOr<std::vector<HostBuffer>> Finish() = 0;

  // Number of voxels with a fragment or filled. Outside the measured time.
  virtual uint64_t CountOccupied() const = 0;
  virtual StageCounts counts() const = 0;
};

// A device kind that can run the pipeline.
class Backend {
 public:
  virtual ~Backend() = default;
  virtual std::string_view name() const = 0;  // "cpu", "cuda"
  virtual std::string_view simd() const = 0;  // instruction set of the row kernels, "scalar" where plain C++

  // `mesh`, `request` and `job` must outlive the returned object, and all calls to it come from inside Run.
  virtual absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                        const JobContext& job) const = 0;

  // Calls `body` where this backend wants its stages called (inside its thread arena).
  virtual void Run(int threads, const std::function<void()>& body) const = 0;
};

}  // namespace voxelpipe
