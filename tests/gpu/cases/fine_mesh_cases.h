// Cases for which fine meshes have paths of their own.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// Occupancy bits in grids so large for the number of triangles that bits are first set in bricks, if the cache is
// small; of meshes that are neither tiny nor huge.
std::vector<ParityCase> BrickCases(const ParityMesh& named, size_t triangles);
// Occupancy bits where triangles of a fine mesh cover a few voxels each and are as many as the voxels of the grid's
// largest face: if the cache is small, most of them are rasterized by rows. Of meshes that are neither small nor huge.
std::vector<ParityCase> RowCases(const ParityMesh& named, size_t triangles);
// Maximum and minimum values of four components in dense results: shaders, coverages, fills, grids and slabs.
std::vector<ParityCase> FourCases(const ParityMesh& named);
// A-buffers where consecutive triangles share voxels: their fragments are grouped if the cache is small. Of meshes that
// are neither tiny nor huge.
std::vector<ParityCase> BundleCases(const ParityMesh& named, size_t triangles);

}  // namespace voxelpipe::gpu
