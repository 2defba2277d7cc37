// Selects the path of a run on a device, once, before the first kernel. A pure function, so it is tested without a GPU.
// No host-only includes except the standard library, no CUDA headers.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "cuda/primitives/span.h"
#include "grid/formats.h"
#include "job/request.h"

namespace voxelpipe::cuda {

// How the targets of a slab are computed; core/cuda/README.md describes each path.
enum class Path : uint8_t {
  kNothing,       // coverage `none`
  kOccupancy,     // occupancy bits only: rows of voxels set in the bit grid
  kInPlace,       // one target with one value per triangle: blended in the target during rasterization
  kFloat4,        // the same with four floats per voxel, for fine meshes
  kBricks,        // one target with one key per voxel: blended in bricks that are allocated on demand
  kAccumulators,  // coverage records and spans, blended into accumulators of covered voxels
  kFragmentList,  // sort-last: the A-buffer
};

// Where the values of a target come from.
enum class ValueSource : uint8_t {
  kCoverage,   // the occupancy bit: the coverage is the value
  kTriangles,  // one value per triangle, shaded once
  // Replace and first with shaders that keep every fragment: find each voxel's owner, then shade it.
  kOwners,
  kFragments,  // every fragment is shaded
};

// Properties of a target that the plan depends on.
struct PathTarget {
  VoxelFormat format = VoxelFormat::kBit;
  Blend blend = Blend::kOr;
  int components = 1;
  bool clears_to_zero = true;
  bool is_occupancy = false;       // a bit target of the occupancy shader
  bool may_discard = false;        // the shader may discard some fragment of this mesh
  bool same_for_triangle = false;  // the shader returns one value for all fragments of a triangle
};

struct PathInputs {
  ResultKind result = ResultKind::kDense;
  Coverage coverage = Coverage::kConservative;
  Fill fill = Fill::kNone;
  bool by_parts = false;  // parts are filled (FillsParts): what owns a voxel is found in accumulators
  bool planar = false;
  std::array<PathTarget, kMaxTargets> targets{};
  int target_count = 0;
  uint64_t triangles = 0;
  bool rows_fit = true;         // occupancy bits may be set row by row (RowBitsFit)
  bool fixed_point = true;      // the fixed-point filter decides most triangles
  uint64_t fine_triangles = 0;  // number of triangles that fills the device with several triangles per thread
};

struct PathPlan {
  Path path = Path::kNothing;
  struct Target {
    ValueSource source = ValueSource::kCoverage;
    bool in_place = false;  // blended in the dense target itself
  };
  std::array<Target, kMaxTargets> targets{};
  bool by_parts = false;  // as in PathInputs

  // True if small triangles become records or are blended as soon as they are found.
  bool blends() const { return path >= Path::kInPlace && path <= Path::kAccumulators; }
};

// Limits of the span encoding (primitives/span.h): bits of a slab's bit grid, and triangles of one list.
struct SpanLimits {
  uint64_t slab_bits = kMaxSpanBits, triangles = kMaxSpanTriangles;
};
// Limits later runs, so that small grids take several slabs and small meshes several lists: for tests. Thread-safe.
void SetSpanLimits(const SpanLimits& limits);
SpanLimits GetSpanLimits();
// Maximum layers of a slab whose bit grid has at most `bits` bits: a multiple of kSlabGranularity, at least that.
int64_t MaxSlabLayers(const std::array<int64_t, 3>& dims, uint64_t bits);

PathPlan PlanPath(const PathInputs& in);
// Replaces the path if the brick pool does not fit.
void GoWithoutBricks(const PathInputs& in, PathPlan& plan);

// True if the target's blend is a single 32-bit atomic on its stored cells, starting from the clear value.
bool BlendsInPlace(const PathTarget& target);
// True if a brick pool can hold the target: one key per voxel, never 0.
bool FitsBricks(const PathTarget& target, ResultKind result);

// Name of a target's path in `--json`: "occupancy", "triangles in place", ...
std::string PathName(const PathPlan& plan, int target);

}  // namespace voxelpipe::cuda
