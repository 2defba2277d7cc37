// The decision table of paths; core/cuda/README.md lists the conditions.
#include "cuda/plan/path_plan.h"

#include <algorithm>
#include <atomic>

#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe::cuda {
namespace {

std::atomic<uint64_t> slab_bits{kMaxSpanBits}, list_triangles{kMaxSpanTriangles};  // see SetSpanLimits

bool HasOwner(const PathTarget& target) {
  return target.blend == Blend::kReplace || target.blend == Blend::kFirst;
}
bool IsOrdered(const PathTarget& target) {
  return target.blend == Blend::kMax || target.blend == Blend::kMin;
}

ValueSource SourceOf(const PathTarget& target) {
  if (target.is_occupancy) return ValueSource::kCoverage;
  if (target.may_discard) return ValueSource::kFragments;
  if (HasOwner(target)) return ValueSource::kOwners;
  const bool once = target.same_for_triangle && target.format != VoxelFormat::kBit;
  return once ? ValueSource::kTriangles : ValueSource::kFragments;
}

// Number of targets that are not the occupancy bit, and the index of the last one.
struct Values {
  int count = 0, last = 0;
};
Values TargetsWithValues(const PathInputs& in) {
  Values values;
  for (int i = 0; i < in.target_count; ++i) {
    if (in.targets[size_t(i)].is_occupancy) continue;
    ++values.count;
    values.last = i;
  }
  return values;
}

// The path of targets blended by records. The value sources of the plan are set already.
Path BlendingPath(const PathInputs& in, const PathPlan& plan, bool bricks) {
  const Values values = TargetsWithValues(in);
  if (values.count != 1) return Path::kAccumulators;
  const PathTarget& target = in.targets[size_t(values.last)];
  const PathPlan::Target& planned = plan.targets[size_t(values.last)];
  if (bricks && in.target_count == 1 && in.triangles > 0 && in.fill == Fill::kNone && FitsBricks(target, in.result)) {
    return Path::kBricks;
  }
  if (!planned.in_place || !IsOrdered(target)) return Path::kAccumulators;
  if (target.components == 1) return Path::kInPlace;
  // Prefetched triangle ids have 31 bits.
  const bool numbers_fit = in.triangles < uint64_t{1} << 31;
  const bool float4 = target.components == 4 && target.format == VoxelFormat::kF32 && !in.planar;
  const bool fine = in.triangles >= in.fine_triangles && in.fixed_point;
  return float4 && fine && numbers_fit ? Path::kFloat4 : Path::kAccumulators;
}

}  // namespace

bool BlendsInPlace(const PathTarget& target) {
  if (!target.clears_to_zero) return false;
  const bool u32 = target.format == VoxelFormat::kU32, f32 = target.format == VoxelFormat::kF32;
  if (IsOrdered(target)) return u32 || f32;
  return u32 && (target.blend == Blend::kOr || target.blend == Blend::kCount);
}

bool FitsBricks(const PathTarget& target, ResultKind result) {
  const ValueSource source = SourceOf(target);
  if (source == ValueSource::kOwners) return target.format != VoxelFormat::kBit;
  const bool is_float = target.format == VoxelFormat::kF16 || target.format == VoxelFormat::kF32;
  return result == ResultKind::kSparse && source == ValueSource::kTriangles && is_float && IsOrdered(target) &&
         target.components == 1;
}

void SetSpanLimits(const SpanLimits& limits) {
  slab_bits = limits.slab_bits;
  list_triangles = limits.triangles;
}
SpanLimits GetSpanLimits() {
  return {slab_bits, list_triangles};
}

int64_t MaxSlabLayers(const std::array<int64_t, 3>& dims, uint64_t bits) {
  const uint64_t of_layer = (uint64_t(dims[0]) + 31) / 32 * 32 * uint64_t(dims[1]);
  const auto granularity = uint64_t{kSlabGranularity};
  return int64_t(std::max<uint64_t>(bits / of_layer / granularity, 1) * granularity);
}

PathPlan PlanPath(const PathInputs& in) {
  PathPlan plan;
  plan.by_parts = in.by_parts;
  for (int i = 0; i < in.target_count; ++i) {
    const PathTarget& target = in.targets[size_t(i)];
    PathPlan::Target& planned = plan.targets[size_t(i)];
    planned.source = SourceOf(target);
    planned.in_place =
        in.result == ResultKind::kDense && planned.source == ValueSource::kTriangles && BlendsInPlace(target);
  }
  if (in.result == ResultKind::kBuckets) {
    plan.path = Path::kFragmentList;
  } else if (in.coverage == Coverage::kNone) {
    plan.path = Path::kNothing;
  } else if (in.by_parts) {
    plan.path = Path::kAccumulators;
  } else if (in.rows_fit && TargetsWithValues(in).count == 0) {
    plan.path = Path::kOccupancy;
  } else {
    plan.path = BlendingPath(in, plan, /*bricks=*/true);
  }
  return plan;
}

void GoWithoutBricks(const PathInputs& in, PathPlan& plan) {
  plan.path = BlendingPath(in, plan, /*bricks=*/false);
}

namespace {

std::string NameOf(const PathPlan& plan, int target) {
  constexpr const char* kSources[] = {"coverage", "triangles", "owners", "fragments"};
  const PathPlan::Target& planned = plan.targets[size_t(target)];
  const std::string source = kSources[size_t(planned.source)];
  switch (plan.path) {
    case Path::kNothing: return "nothing";
    case Path::kOccupancy: return "occupancy";
    case Path::kFragmentList: return "fragment list";
    default: break;
  }
  if (planned.source == ValueSource::kCoverage) return "coverage";
  switch (plan.path) {
    case Path::kInPlace: return source + " in place";
    case Path::kFloat4: return source + " in place, float4";
    case Path::kBricks: return source + " in bricks";
    default: return source + (planned.in_place ? " in place, by records" : " in accumulators");
  }
}

}  // namespace

std::string PathName(const PathPlan& plan, int target) {
  return NameOf(plan, target) + (plan.by_parts ? ", by parts" : "");
}

}  // namespace voxelpipe::cuda
