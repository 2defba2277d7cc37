// Cases for which fine meshes have ways of their own.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// Plain bits in grids so large for so many triangles that they are set in bricks first, where the cache is small; of
// meshes that are neither tiny nor huge.
std::vector<ParityCase> BrickCases(const ParityMesh& named, size_t triangles);
// Plain bits where triangles of a fine mesh reach over a few voxels each, and are as many as the grid's largest face
// has voxels: where the cache is small most of them go by rows at once. Of meshes that are neither small nor huge.
std::vector<ParityCase> RowCases(const ParityMesh& named, size_t triangles);
// Largest and least values of four components in dense results: shaders, coverages, fills, grids and slabs.
std::vector<ParityCase> FourCases(const ParityMesh& named);
// A-buffers where triangles that follow one another have voxels in common: their fragments are bundled where the cache
// is small. Of meshes that are neither tiny nor huge.
std::vector<ParityCase> BundleCases(const ParityMesh& named, size_t triangles);

}  // namespace voxelpipe::gpu
