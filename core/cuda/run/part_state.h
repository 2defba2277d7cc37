// What a run holds where parts are filled (FillsParts).
//
// Triangles are numbered by the rank of their part, then by id (host_mesh/order_parts.h): of the triangles of a voxel
// the largest number is the owner's.
#pragma once

#include <array>
#include <cstdint>

#include "cuda/device/buffer.h"
#include "cuda/primitives/part_order.h"
#include "cuda/primitives/views.h"
#include "shaders/fill_value.h"

namespace voxelpipe::cuda {

struct PartState {
  // VertexShade
  bool filled = false;       // FillsParts; if false, nothing else is set
  bool ids_in_order = true;  // numbers of triangles are ids
  uint32_t count = 0;        // parts
  DeviceArray<IdRun> by_id;  // unless ids_in_order

  // FindOwners, first slab: by rank; empty if the target's fill value is the same in all parts
  std::array<DeviceArray<FillValue>, kMaxTargets> fills;
  bool has_fills = false;

  // Of the slab.
  DeviceArray<uint16_t> inside_ranks;  // of each voxel the rank plus 1 of the highest part around its centre, or 0
  DeviceArray<uint64_t> counts;        // by rank: odd columns; then, by rank again, voxels owned
  // Accumulators of owners by geometry, discarded fragments included, if no target's are the same.
  DeviceArray<uint32_t> owners;

  void FreeSlab() {
    inside_ranks.Free();
    counts.Free();
    owners.Free();
  }
};

}  // namespace voxelpipe::cuda
