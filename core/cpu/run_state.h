// The state that the stages of one run share, in the order in which they set it.
#pragma once

#include <tbb/enumerable_thread_specific.h>
#include <array>
#include <memory>

#include <optional>
#include <span>
#include <vector>

#include "cpu/base/pair_blocks.h"
#include "cpu/base/stream.h"
#include "cpu/base/tile_values.h"
#include "cpu/rows/row_bits.h"
#include "cpu/shading/shade_kernels.h"
#include "grid/bit_grid.h"
#include "host_mesh/host_mesh.h"
#include "pipeline/stages/stages.h"
#include "raster/tiles.h"
#include "shaders/fill_value.h"
#include "shaders/shader_list.h"

namespace voxelpipe::cpu {

// A run of equal tiles in RunState::pairs.
struct TileRun {
  uint64_t begin, end;
};

// A render target while it is rasterized.
struct CpuTarget {
  TargetSpec spec;
  FragmentShaderId shader{};
  ShaderParams params;
  bool u32_output = false;
  VoxelFormat kept_format{};  // KeptFormat of `spec`
  double scale = 1;           // of f32 outputs into integers
  uint32_t clear_stored = 0;  // as stored in the format
  FillValue fill;
  std::span<const FillValue> part_fills;  // by rank, where the fill differs from part to part; else empty
  // Holds the owner's fragment alone: `replace` where parts are filled.
  bool of_owner = false;
  bool ids_unordered = false;  // triangles do not come by id: parts are filled
  // A bit target of the occupancy shader: with every blend its value is the coverage itself, and nothing else is
  // stored.
  bool is_occupancy = false;
  // The shader can discard, or the owner has no fragment, so the target has its own set of written voxels.
  bool own_presence = false;

  BitGrid bits;      // values of a bit target, unless is_occupancy
  BitGrid presence;  // if own_presence
  HostBuffer dense;  // values of a target that is not bit, in the result's layout over the slab

  // True if the values are so many that streaming stores write them.
  bool streams() const { return dense.size() > kCachedBytes; }
};

struct ABuffer;

struct RunState : HostMesh {
  using HostMesh::HostMesh;

  ListMemory* lists = nullptr;  // consulted before lists exceed their share of the plan; may be null

  // CoarseRaster, TileSort: of the whole grid
  GridSpec grid;
  int64_t dims[3] = {1, 1, 1};
  TileGrid tiles{};
  // Occupancy bits alone: rasterized by row spans instead of tiles; `pairs` and `runs` stay empty.
  const RowKernels* kernels = nullptr;
  const RowKernels* tile_kernels = nullptr;  // for tiles: the scalar kernels if coordinates do not fit the lanes
  const ShadeKernels* shade_kernels = nullptr;
  std::unique_ptr<RowBits> row_bits;
  HostArray<Vec3d> placed_positions;       // with tiles: the storage of index_positions
  const Vec3d* index_positions = nullptr;  // per vertex, index space
  std::vector<PairBlocks> emitted;         // pairs by ascending triangle, before TileSort
  HostArray<uint64_t> pairs;               // (tile << 32) | triangle, after it
  std::vector<TileRun> runs;               // by ascending tile
  BitGrid enclosed;                        // flood fill: the voxels not reached from outside, set by the first slab

  // Of each target, see CpuTarget::part_fills; from the first slab on. Charged.
  std::optional<std::vector<std::vector<FillValue>>> part_fills;
  MemoryCharge part_fills_memory;

  // BeginSlab: the members below hold the slab's layers only; SlabRow numbers its rows
  Slab slab;
  std::array<int64_t, 3> slab_dims{1, 1, 1};
  std::vector<CpuTarget> targets;
  BitGrid coverage;  // voxels that a fragment of any target wrote
  // Sparse results: the values of the tiles with a fragment, and for each tile of the slab its index among them.
  std::vector<TileValues> tile_values;
  std::vector<uint32_t> slab_tiles;  // UINT32_MAX: no fragment
  tbb::enumerable_thread_specific<ValueArena> value_arenas;
  uint64_t kept_bytes = 0;            // of tile_values
  std::shared_ptr<ABuffer> a_buffer;  // buckets

  // FineRaster, SolidFill
  // FillsParts; the owner of the inside of a voxel is wanted: by a target, or to count the voxels of parts.
  bool by_parts = false, needs_ranks = false;
  HostArray<uint16_t> inside_ranks;  // needs_ranks: of each voxel of the slab, see FillParts
  BitGrid inside;
  SlabCounts counts;
  uint64_t part_count() const { return by_parts ? request.parts->parts.size() : 0; }

  // The fill of a voxel of a slab row; in grid coordinates, with the row's number.
  const FillValue& FillOf(const CpuTarget& target, int64_t slab_row, int64_t x) const {
    if (target.part_fills.empty()) return target.fill;
    return target.part_fills[size_t(inside_ranks[uint64_t(slab_row * dims[0] + x)] - 1)];
  }
  int64_t SlabRow(int64_t y, int64_t z) const { return y + dims[1] * (z - slab.begin); }
  uint64_t slab_voxels() const { return uint64_t(slab_dims[0]) * uint64_t(slab_dims[1]) * uint64_t(slab_dims[2]); }
};

// True if every target is the coverage itself, so that the rasterizer needs no tiles.
bool PlainBits(const HostMesh& mesh, const GridSpec& grid);

// The stages; see pipeline/stages/stages.h for what each does.
absl::Status CoarseRaster(RunState& state, const GridSpec& grid);
absl::Status TileSort(RunState& state);
absl::Status BeginSlab(RunState& state, const Slab& slab);
absl::Status FindOwners(RunState& state);
absl::Status FineRaster(RunState& state);
absl::Status SolidFill(RunState& state);
absl::StatusOr<ResultArrays> Finish(RunState& state);

}  // namespace voxelpipe::cpu
