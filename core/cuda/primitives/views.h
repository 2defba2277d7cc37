// Views of the grid and the targets that are passed to kernels: plain structs without host-only includes, so that NVRTC
// can compile the kernels too.
#pragma once

#include <cstdint>

#include "grid/formats.h"
#include "grid/index_space.h"
#include "mesh/views/mesh_view.h"
#include "raster/tiles.h"
#include "shaders/shader_list.h"

namespace voxelpipe::cuda {

// The grid and the current slab. Rows of bit grids have words_per_row 32-bit words; row index y + dims[1] * (z -
// slab_begin).
struct GridView {
  int64_t dims[3] = {1, 1, 1};
  int64_t slab_begin = 0, slab_end = 1;
  TileGrid tiles{};
  int64_t words_per_row = 1;
  IndexSpace space;

  VOXELPIPE_HD uint64_t Word(int64_t x, int64_t y, int64_t z) const {
    // 32-bit factors: one instruction per product on a device.
    const uint64_t row = uint64_t{uint32_t(dims[1])} * uint32_t(z - slab_begin) + uint64_t(y);
    return row * uint32_t(words_per_row) + uint64_t(x / 32);
  }
  VOXELPIPE_HD VoxelRange SlabRange() const {
    VoxelRange r;
    r.end[0] = dims[0];
    r.end[1] = dims[1];
    r.begin[2] = slab_begin;
    r.end[2] = slab_end;
    return r;
  }
};

inline constexpr int kMaxTargets = 8;

// A render target of the slab; the counterpart of CpuTarget in cpu/run_state.h.
struct CudaTarget {
  VoxelFormat format = VoxelFormat::kBit;
  Blend blend = Blend::kOr;
  int components = 1;
  FragmentShaderId shader{};
  bool u32_output = false;
  bool is_occupancy = false;  // a bit target of the occupancy shader: its value is the coverage itself
  bool may_discard = false;   // the shader may discard some fragment of this mesh
  bool of_owner = false;      // holds the owner's fragment alone: `replace` where parts are filled
  bool own_presence = false;  // either of the two: not every covered voxel has a fragment of the target
  double scale = 1, quantum = 1;
  uint32_t clear_stored = 0;
  ShaderParams params;
  uint32_t* bits = nullptr;      // bit grid: values of a bit target, unless is_occupancy
  uint32_t* presence = nullptr;  // bit grid: if own_presence
  uint8_t* dense = nullptr;  // dense results: values of a target that is not bit, in the result's layout over the slab
};

struct TargetViews {
  CudaTarget at[kMaxTargets];
  int count = 0;
  bool planar = false;
  // No fragment of some target is discarded, so every touched voxel is covered.
  bool any_always_present = false;
};

}  // namespace voxelpipe::cuda
