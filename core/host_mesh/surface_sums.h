// Sums over all triangles that measure a surface, without visiting its voxels.
#pragma once

#include "mesh/views/mesh_view.h"
#include "raster/surface_sums.h"

namespace voxelpipe {

// In: a mesh with finite positions, whose triangles lie in world space; the window of the sums, if the grid is known;
// the centre of the mesh's box. Out: the sums for EstimateSurface (surface.h). The same for any number of threads. The
// twin of MeasureTriangles in cuda/vertex/vertex_kernels.cuh.
SurfaceSums SumSurface(const MeshView& mesh, const GridWindow& window, const Vec3d& centre);

}  // namespace voxelpipe
