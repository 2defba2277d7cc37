// Random jobs for the program that compares plans with the memory of runs.
#pragma once

#include <cstdint>
#include <string>

#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::testing {

struct PlanJob {
  std::string text;  // description, in one line
  bool hostile = false;
  TriangleMesh mesh;
  VoxelizeRequest request;
  PlanLimits limits;  // slabs only; nothing is refused
  bool streamed = false;
};

// The same job for the same seed on every machine. Ordinary ones: smooth and rough surfaces, soups of small triangles,
// terrain, blocks aligned to the grid. Adversarial ones: points on voxel corners, slivers, very large triangles, a
// window into a much larger scene, coinciding surfaces, a few triangles in a large grid, all triangles in one layer.
PlanJob MakePlanJob(uint64_t seed);

}  // namespace voxelpipe::testing
