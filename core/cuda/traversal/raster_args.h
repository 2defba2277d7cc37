// The part of BitArgs that every walk over a run's triangles has in common, and what else is told from the run's grid
// and the mesh's box. Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"
#include "cuda/traversal/raster_args.cuh"
#include "grid/index_space.h"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

// The box of the run's mesh in index space.
inline Box3d BoxInGrid(const RunState& state) {
  const IndexSpace space = state.grid.index_space();
  return {WorldToIndex(space, state.box.min), WorldToIndex(space, state.box.max), state.box.empty};
}

// Names all triangles of the run's mesh, and how they lie in its grid.
inline void SetTriangles(const RunState& state, BitArgs& args) {
  const MeshView& mesh = state.mesh.host_view;
  const Vec3d& size = state.grid.voxel_size;
  if (mesh.triangle_count > 0) {
    const Box3d box = BoxInGrid(state);
    args.fixed = MakeFixedPlace(state.grid.index_space(), box.min, box.max);
  }
  args.inverse_size = {1 / size.x, 1 / size.y, 1 / size.z};
  args.triangles = state.mesh.triangle_list();
  args.positions = mesh.positions;
  args.triangle_count = mesh.triangle_count;
}

// True if fixed point decides what most triangles touch (fixed_point.h).
inline bool HasFixed(const BitArgs& args) {
  return args.fixed.bits > 0 && args.coverage != Coverage::kCenter;
}

// The test of the run's triangles.
inline DegenerateTest DegenerateTestOf(const RunState& state) {
  const Box3d box = BoxInGrid(state);
  return MakeDegenerateTest(state.grid.index_space(), box.min, box.max);
}

// Has the walk read packed vertices, where there are such (mesh_locality.h). `placed`: triangles are then numbered by
// place.
inline void UsePacked(const RunState& state, BitArgs& args, bool placed = false) {
  const ScatteredMesh& scattered = state.scattered_mesh;
  if (scattered.packed == nullptr || args.fixed.bits == 0) return;
  args.packed = placed ? scattered.placed : scattered.packed;
  args.packed_place =
      MakePackedPlace(args.fixed, state.grid.origin, state.grid.voxel_size, state.box.min, scattered.extent);
}

}  // namespace voxelpipe::cuda
