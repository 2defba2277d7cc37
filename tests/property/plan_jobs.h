// Random jobs for the program that compares plans with what runs take.
#pragma once

#include <cstdint>
#include <string>

#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::testing {

struct PlanJob {
  std::string text;  // what it is, in one line
  bool hostile = false;
  TriangleMesh mesh;
  VoxelizeRequest request;
  PlanLimits limits;  // slabs only; nothing is refused
  bool streamed = false;
};

// The same job for the same seed, everywhere. Honest ones: smooth and rough surfaces, soups of small triangles,
// terrain, blocks on the lattice. Hostile ones: points on voxel corners, slivers, giants, a window into a much larger
// scene, surfaces that lie in each other, all triangles in one layer.
PlanJob MakePlanJob(uint64_t seed);

}  // namespace voxelpipe::testing
