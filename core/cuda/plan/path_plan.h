// Which path a run takes on a device: decided once, from what is known before the first kernel. A pure function, so
// that it is tested without a GPU. No host-only includes but the standard library's, no CUDA headers.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "cuda/primitives/span.h"
#include "grid/formats.h"
#include "job/request.h"

namespace voxelpipe::cuda {

// How a slab's targets are made; core/cuda/README.md describes each.
enum class Path : uint8_t {
  kNothing,       // coverage `none`
  kOccupancy,     // occupancy bits alone: rows of voxels set in the bit grid
  kInPlace,       // one target of one value a triangle: blended where it lies, while triangles are found
  kFloat4,        // the same of four floats a voxel, for fine meshes
  kBricks,        // one target whose voxels keep one key each: blended in bricks that are given out meanwhile
  kAccumulators,  // coverage records and spans, blended into accumulators of covered voxels
  kFragmentList,  // sort-last: the A-buffer
};

// How a target gets its values.
enum class ValueSource : uint8_t {
  kCoverage,   // the occupancy bit: the coverage itself
  kTriangles,  // one value a triangle, shaded once
  kOwners,     // replace and first, of shaders that keep every fragment: the owner of each voxel is found, then shaded
  kFragments,  // every fragment is shaded
};

// What the plan asks of a target.
struct PathTarget {
  VoxelFormat format = VoxelFormat::kBit;
  Blend blend = Blend::kOr;
  int components = 1;
  bool clears_to_zero = true;
  bool is_occupancy = false;       // of the occupancy shader, in bits
  bool may_discard = false;        // the shader, of some fragment of this mesh
  bool same_for_triangle = false;  // the shader gives all fragments of each triangle one value
};

struct PathInputs {
  ResultKind result = ResultKind::kDense;
  Coverage coverage = Coverage::kConservative;
  Fill fill = Fill::kNone;
  bool planar = false;
  std::array<PathTarget, kMaxTargets> targets{};
  int target_count = 0;
  uint64_t triangles = 0;
  bool rows_fit = true;         // occupancy bits may be set by rows (RowBitsFit)
  bool fixed_point = true;      // fixed point decides what most triangles touch
  uint64_t fine_triangles = 0;  // a mesh of so many keeps the device busy with some triangles a thread
};

struct PathPlan {
  Path path = Path::kNothing;
  struct Target {
    ValueSource source = ValueSource::kCoverage;
    bool in_place = false;  // blended in the dense target itself
  };
  std::array<Target, kMaxTargets> targets{};

  // True if small triangles become records, or are blended as they are found.
  bool blends() const { return path >= Path::kInPlace && path <= Path::kAccumulators; }
};

// What spans (primitives/span.h) have numbers for: bits of a slab's bit grid, and triangles of one list.
struct SpanLimits {
  uint64_t slab_bits = kMaxSpanBits, triangles = kMaxSpanTriangles;
};
// Limits runs that begin afterwards, so that small grids take several slabs and small meshes several lists: for tests.
// Thread-safe.
void SetSpanLimits(const SpanLimits& limits);
SpanLimits GetSpanLimits();
// The most layers of a slab whose bit grid has at most `bits` bits: a multiple of kSlabGranularity, which is the least.
int64_t MaxSlabLayers(const std::array<int64_t, 3>& dims, uint64_t bits);

PathPlan PlanPath(const PathInputs& in);
// The same without a pool of bricks, which found no room.
void GoWithoutBricks(const PathInputs& in, PathPlan& plan);

// True if a dense target's blend is one 32-bit atomic on its stored cells, beginning from the clear value.
bool BlendsInPlace(const PathTarget& target);
// True if a pool of bricks can hold the target: one key a voxel, that is never 0.
bool FitsBricks(const PathTarget& target, ResultKind result);

// What `--json` shows of a target: "occupancy", "triangles, in place", ...
std::string PathName(const PathPlan& plan, int target);

}  // namespace voxelpipe::cuda
