// Parity cases, for which two backends must return the same bytes: formats, blends, shaders, coverages, fills, kinds,
// layouts, grids and slabs, combined.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "gpu/cases/parity_meshes.h"
#include "job/request.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::gpu {

struct ParityCase {
  VoxelizeRequest request;
  int64_t slab_depth = 0;  // of the backend under test; 0 = the plan's choice
  bool streamed = false;   // VoxelizeTo instead of Voxelize
  uint64_t enough = 0;     // limit of device memory, which forces slabs; 0: no limit
};

// A grid by dims, voxel size and origin.
GridRequest Placed(std::array<int64_t, 3> dims, const Vec3d& origin, const Vec3d& voxel);

// One line, sufficient to reproduce the request.
std::string Describe(const ParityCase& c);

// The features of a request, a word each: the result kind, coverage, ..., each format, blend and shader. For tallies.
std::vector<std::string> FeaturesOf(const ParityCase& c);

struct CaseSizes {
  int random = 0;           // requests with several targets, everything chosen at random
  bool plain_bits = false;  // every coverage, fill and kind of the default target, on several grids
  bool all_targets =
      false;  // every shader x format x blend x kind in requests of eight targets, and single targets too
};

// The requests of one mesh; the same ones for the same seed.
std::vector<ParityCase> CasesFor(const ParityMesh& named, const TriangleMesh& mesh, const CaseSizes& sizes,
                                 uint32_t seed);
inline void AppendTo(std::vector<ParityCase>& cases, const std::vector<ParityCase>& more) {
  cases.insert(cases.end(), more.begin(), more.end());
}
// Each kernel once or twice, small enough for a sanitizer.
std::vector<ParityCase> QuickCases(const ParityMesh& named);
// Maximum and minimum values in sparse results, which have a path of their own: shaders, formats, coverages, grids and
// slabs.
std::vector<ParityCase> PooledCases(const ParityMesh& named);
// The largest triangle ids in dense results, whose covered voxels are counted by their values: formats, coverages,
// grids and slabs.
std::vector<ParityCase> LargestIdCases(const ParityMesh& named);
// Each path, in a grid of 56 layers, for meshes about [0, 40].
std::vector<ParityCase> SlabCases();
// Every vertex shader that the mesh supports, with each result kind: positions alone, and all that fragment shaders
// read.
std::vector<ParityCase> VertexShaderCases(const ParityMesh& named, const TriangleMesh& mesh);

// Grids for a mesh of coordinates about [0, extent]. In most of them index space is world space; the others have a
// fractional origin.
std::vector<GridRequest> GridsFor(double extent);

}  // namespace voxelpipe::gpu
