// Measurements of meshes that are kept between runs.
#pragma once

#include <optional>
#include <string>

#include "grid/grid_spec.h"
#include "host_mesh/host_mesh.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

// All that a measurement follows from. Empty where nothing identifies the mesh (TriangleMesh::content_id), it has moved
// (mesh/content_id.h), or the run has its own vertices or order of triangles.
std::string SurfaceKey(const HostMesh& mesh, const GridSpec& grid, bool closely);

// What was measured last, of a small number of keys; nothing for an empty key. Thread-safe.
std::optional<Surface> FindSurface(const std::string& key);
void KeepSurface(const std::string& key, const Surface& surface);

}  // namespace voxelpipe
