// The sums that say how large a surface is, by a look at each triangle but none at its voxels.
#pragma once

#include "mesh/views/mesh_view.h"
#include "raster/surface_sums.h"

namespace voxelpipe::cpu {

// In: a mesh with finite positions, whose triangles lie in world space; the window that the sums are made in, if one is
// known; the centre of the mesh's box. Out: the sums for EstimateSurface (surface.h). The same for any number
// of threads. The twin of MeasureTriangles in cuda/vertex/vertex_kernels.cuh.
SurfaceSums SumSurface(const MeshView& mesh, const GridWindow& window, const Vec3d& centre);

}  // namespace voxelpipe::cpu
