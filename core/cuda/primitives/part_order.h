// Numbers, ids and parts of triangles where parts are filled (host_mesh/order_parts.h). No host-only includes.
#pragma once

#include <cstdint>

#include "mesh/views/mesh_view.h"

namespace voxelpipe::cuda {

// A run of triangles in the order of ids: id - id_offset is the number of one from first_id on, up to the next run.
struct IdRun {
  uint32_t first_id = 0, id_offset = 0;
};

// The number of the triangle with an id, by binary search in runs by ascending first_id.
VOXELPIPE_HD uint32_t NumberOf(const IdRun* runs, uint32_t count, uint32_t id) {
  uint32_t lo = 0, hi = count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (runs[mid].first_id <= id) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  return id - runs[lo].id_offset;
}

// The runs of a mesh by ascending number of their first triangle.
struct PartRuns {
  const PartView* parts = nullptr;
  uint32_t count = 0;

  VOXELPIPE_HD const PartView& Of(uint64_t number) const {
    MeshView mesh;
    mesh.parts = parts;
    mesh.part_count = count;
    return parts[PartOf(mesh, number)];
  }
};

}  // namespace voxelpipe::cuda
