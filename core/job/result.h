// The result of a run: arrays over a grid, in memory or streamed in pieces.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "grid/grid_spec.h"
#include "grid/host_buffer.h"
#include "grid/voxel_format.h"
#include "job/part_table.h"
#include "job/request.h"
#include "job/stats.h"

namespace voxelpipe {

// Element of a result's array. kBit: packed, element n is bit n%8 of byte n/8, unused bits 0. All others little endian.
enum class ElementType : uint8_t { kBit, kU8, kU16, kU32, kU64, kF16, kF32, kI32 };

std::string_view Name(ElementType type);
ElementType ElementOf(VoxelFormat format);
// Bytes of `count` elements: a whole number, rounded up for kBit.
uint64_t ArrayBytes(ElementType type, uint64_t count);

// One array of a result. `shape` is C order (last fastest).
struct ArraySpec {
  std::string name;
  ElementType type = ElementType::kU8;
  std::vector<uint64_t> shape;

  uint64_t bytes() const;
  friend bool operator==(const ArraySpec&, const ArraySpec&) = default;
};

// The arrays of a result "in stream order", which is the order of the content hash too:
//   dense    target0, target1, ...   (nz, ny, nx), with c components (nz, ny, nx, c), planar (c, nz, ny, nx)
//   sparse   brick u64 (b)           ids of the bricks with an occupied voxel, ascending; of a brick of 8x8x8 voxels:
//                                    bx + ceil(nx/8)*(by + ceil(ny/8)*bz)
//            mask u8 (b, 64)         bit x + 8*(y + 8*z) of a brick: that voxel has a fragment or is filled
//            target0, ...            values of the n occupied voxels, brick after brick, in mask order: (n), (n, c),
//                                    planar (c, n)
//   buckets  voxel u64 (n)           linear indices of the voxels with a fragment, ascending
//            offset u64 (n + 1)      fragments of voxel i are [offset[i], offset[i+1])
//            triangle u32 (m)        of each fragment, ascending within a voxel
//            target0, ...            the shader's output of each fragment: (m), (m, c), planar (c, m)
// Where the request cuts the mesh into p parts, behind the targets (part_table.h):
//            part_label u32 (p), part_priority i32 (p), part_triangles u64 (p)
//            part_open_edges, part_odd_columns, part_voxels u64 (p)      with a fill
//            part_name_offset u64 (p + 1), part_name u8 (bytes)
struct ResultHeader {
  ResultKind kind = ResultKind::kDense;
  GridSpec grid;
  Layout layout = Layout::kInterleaved;
  std::vector<TargetSpec> specs;  // as requested
  std::vector<ArraySpec> arrays;  // in stream order

  // Arrays before the targets': 0, 2 or 3, by kind. Behind the targets those of the parts follow.
  size_t lists() const { return kind == ResultKind::kDense ? 0 : kind == ResultKind::kSparse ? 2 : 3; }
  size_t first_part_array() const { return lists() + specs.size(); }
  // No parts if the arrays of parts are not there.
  PartShape parts() const;
};

// Bytes in a GPU's memory, for work of that GPU. `owner` frees them; no work may use them then.
struct DeviceBuffer {
  std::shared_ptr<void> owner;
  void* data = nullptr;  // a device pointer
  uint64_t size = 0;
  int ordinal = 0;  // the device's CUDA ordinal
};

// The arrays themselves, of a whole result or of one slab.
struct ResultArrays {
  std::vector<HostBuffer> targets;           // one a spec, in format and layout
  std::vector<DeviceBuffer> device_targets;  // in place of `targets`: see RunOptions::on_device
  // Index arrays, empty where the kind has none.
  HostBuffer bricks, masks;               // sparse
  HostBuffer voxels, offsets, triangles;  // buckets

  uint64_t bytes() const {
    uint64_t sum = bricks.size() + masks.size() + voxels.size() + offsets.size() + triangles.size();
    for (const HostBuffer& target : targets) sum += target.size();
    for (const DeviceBuffer& target : device_targets) sum += target.size;
    return sum;
  }
};

struct VoxelizeResult : ResultArrays {
  ResultKind kind = ResultKind::kDense;
  GridSpec grid;
  Layout layout = Layout::kInterleaved;
  std::vector<TargetSpec> specs;  // as requested
  PartTable parts;
  VoxelizeStats stats;

  // Occupied voxels that a sparse or bucketed result lists, fragments of a bucketed one.
  uint64_t listed_bricks() const { return bricks.size() / sizeof(uint64_t); }
  uint64_t listed_voxels() const;  // sparse: set bits of the masks; buckets: entries of `voxels`; dense: all voxels
  uint64_t listed_fragments() const { return triangles.size() / sizeof(uint32_t); }
};

// The header of dense results is known before the run.
ResultHeader DenseHeader(const VoxelizeRequest& request, const GridSpec& grid, const PartShape& parts = {});
// In: the counts of the lists (see VoxelizeResult). Out: the header of a sparse or bucketed result; dense ignores them.
ResultHeader MakeResultHeader(const VoxelizeRequest& request, const GridSpec& grid, uint64_t bricks, uint64_t voxels,
                              uint64_t fragments, const PartShape& parts = {});
ResultHeader HeaderOf(const VoxelizeResult& result);
// Of all arrays together.
uint64_t BytesOf(const ResultHeader& header);

// The bytes of the arrays in stream order, one span an array of HeaderOf(result). Owned by `result`.
std::vector<std::span<const uint8_t>> ArraysOf(const VoxelizeResult& result);
std::vector<std::span<uint8_t>> MutableArraysOf(VoxelizeResult& result);

// An empty result with the header's kind, grid and specs, every array allocated, contents undefined.
absl::StatusOr<VoxelizeResult> AllocateResult(const ResultHeader& header);

// Receives a result while it is made. Calls are sequential: Begin once, then Write for consecutive pieces in stream
// order. A status other than OK ends the run with that status.
class ResultSink {
 public:
  virtual ~ResultSink() = default;
  // Called first if the whole result is in memory (without its statistics yet). True if the sink keeps it; then neither
  // Begin nor Write is called.
  virtual bool Keep(VoxelizeResult&& /*whole*/) { return false; }
  virtual absl::Status Begin(const ResultHeader& header) = 0;
  // `bytes` directly follow the bytes of header.arrays[array] written before; valid during the call only.
  virtual absl::Status Write(size_t array, std::span<const uint8_t> bytes) = 0;
};

// Writes a result in memory to a sink.
absl::Status WriteTo(const VoxelizeResult& result, ResultSink& sink);

}  // namespace voxelpipe
