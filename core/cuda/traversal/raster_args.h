// Fills the parts of BitArgs that are common to all rasterization of a run's triangles, from the grid and the mesh's
// bounding box. Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"
#include "cuda/traversal/raster_args.cuh"
#include "grid/index_space.h"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

// The mesh's bounding box in index space.
inline Box3d BoxInGrid(const RunState& state) {
  const IndexSpace space = state.grid.index_space();
  return {WorldToIndex(space, state.box.min), WorldToIndex(space, state.box.max), state.box.empty};
}

// Sets the triangles of the run's mesh and the fixed-point transform to its grid.
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

// True if the fixed-point filter decides most triangles (fixed_point.h).
inline bool HasFixed(const BitArgs& args) {
  return args.fixed.bits > 0 && args.coverage != Coverage::kCenter;
}

// The test for degenerate triangles of the run's mesh.
inline DegenerateTest DegenerateTestOf(const RunState& state) {
  const Box3d box = BoxInGrid(state);
  return MakeDegenerateTest(state.grid.index_space(), box.min, box.max);
}

// Makes kernels read packed vertices if they exist (mesh_locality.h). `placed`: in Morton order, which then numbers the
// triangles.
inline void UsePacked(const RunState& state, BitArgs& args, bool placed = false) {
  const ScatteredMesh& scattered = state.scattered_mesh;
  if (scattered.packed == nullptr || args.fixed.bits == 0) return;
  args.packed = placed ? scattered.placed : scattered.packed;
  args.packed_place =
      MakePackedPlace(args.fixed, state.grid.origin, state.grid.voxel_size, state.box.min, scattered.extent);
}

// The triangles of the run in the order of the records of FindAllCells; null: by id.
inline const PackedVertex* PlacedTriangles(const RunState& state) {
  BitArgs args;
  SetTriangles(state, args);
  UsePacked(state, args, /*placed=*/true);
  return args.packed;
}

}  // namespace voxelpipe::cuda
