#include "gpu/cases/scattered_cases.h"

#include <utility>

namespace voxelpipe::gpu {
namespace {

constexpr Coverage kScatteredCoverages[] = {Coverage::kConservative, Coverage::kThin};

// Largest and least values, which are written with the largest triangles in them, where the grids are larger than the
// cache.
void AddFilled(std::vector<ParityCase>& cases, const GridRequest& small, const std::vector<GridRequest>& others) {
  const auto value = [](VoxelFormat format, Blend blend, const char* shader) {
    TargetSpec target;
    target.format = format;
    target.blend = blend;
    target.shader = {shader, {}};
    return target;
  };
  const auto add = [&](const GridRequest& grid, std::vector<TargetSpec> targets) {
    ParityCase c;
    c.request.grid = grid;
    c.request.coverage = kScatteredCoverages[cases.size() % 2];
    c.request.targets = std::move(targets);
    if (cases.size() % 4 == 0) c.slab_depth = 88;  // of many rows still
    if (cases.size() % 5 == 0) c.request.fill = Fill::kParity;
    cases.push_back(c);
  };
  const TargetSpec most = value(VoxelFormat::kF32, Blend::kMax, "triangle_id"),
                   least = value(VoxelFormat::kU32, Blend::kMin, "triangle_id"),
                   across = value(VoxelFormat::kF32, Blend::kMax, "normal"),  // of either sign
      along = value(VoxelFormat::kF32, Blend::kMin, "geometric_normal");
  TargetSpec cleared = most;
  cleared.clear = 3;  // not written so: nor are those beside it
  for (const TargetSpec& target : {most, least, across, along}) add(small, {target});
  add(small, {most, cleared});
  for (const GridRequest& grid : others) {
    add(grid, {most, TargetSpec(), least, along});
    add(grid, {across});
  }
}

}  // namespace

std::vector<ParityCase> ScatteredCases() {
  std::vector<ParityCase> cases;
  const auto add = [&](const GridRequest& grid, std::vector<TargetSpec> targets) -> ParityCase& {
    ParityCase c;
    c.request.grid = grid;
    c.request.coverage = kScatteredCoverages[cases.size() % 2];
    c.request.targets = std::move(targets);
    cases.push_back(c);
    return cases.back();
  };
  const auto sum = [](VoxelFormat format, int components, double clear) {
    TargetSpec target;
    target.format = format;
    target.components = components;
    target.blend = Blend::kAdd;
    target.shader = {components == 1 ? "triangle_id" : "normal", {}};
    target.clear = clear;
    return target;
  };
  // So many rows that the giants count as large.
  const GridRequest narrow = Placed({32, 110, 110}, {10, 0, 0}, {2.5, 1, 1});
  const GridRequest slanted = Placed({64, 100, 96}, {5, 3, 2}, {1.5, 1, 1.1});
  for (const GridRequest& grid :
       {narrow, Placed({128, 80, 90}, {0, 5, 0}, {1, 1.25, 1.2}), Placed({160, 80, 80}, {0, 0, 0}, {0.7, 1.3, 1.3})}) {
    add(grid, {TargetSpec()});
    add(grid, {TargetSpec()});
  }
  add(narrow, {sum(VoxelFormat::kF32, 1, 0)});
  add(narrow, {sum(VoxelFormat::kF32, 2, -1.5)}).slab_depth = 80;
  add(narrow, {sum(VoxelFormat::kF32, 4, 0)});
  add(narrow, {sum(VoxelFormat::kU32, 1, 7)});
  add(narrow, {sum(VoxelFormat::kF32, 4, 0), sum(VoxelFormat::kU32, 1, 0), TargetSpec()});
  add(slanted, {sum(VoxelFormat::kF32, 1, 0.5)}).slab_depth = 88;
  add(slanted, {sum(VoxelFormat::kF32, 4, 1)});
  // Others beside them, which take the largest triangles as spans.
  TargetSpec greatest = sum(VoxelFormat::kF32, 1, 0);
  greatest.blend = Blend::kMax;
  add(slanted, {sum(VoxelFormat::kF32, 1, 0), greatest, sum(VoxelFormat::kF32, 3, 0)});
  // With a cache of 2 KB full slabs are ordered, and cover voxels; the last one, of a layer, is not, and touches
  // blocks.
  add(Placed({40, 48, 41}, {0, 0, 0}, {2.7, 2.2, 2.6}), {greatest}).slab_depth = 8;
  ParityCase& filled = add(slanted, {sum(VoxelFormat::kF32, 1, 0)});
  filled.request.fill = Fill::kParity;
  filled.request.layout = Layout::kPlanar;
  const GridRequest parts_of_rows = Placed({1056, 96, 90}, {-5, 10, 20}, {0.11, 1.02, 1});
  add(parts_of_rows, {sum(VoxelFormat::kF32, 2, 0)});
  AddFilled(cases, narrow, {slanted, parts_of_rows});
  // A-buffers, in which the largest triangles are put among the others' fragments: with values, too, and with shaders
  // that discard.
  const auto add_buckets = [&](const GridRequest& grid, std::vector<TargetSpec> targets) -> ParityCase& {
    ParityCase& c = add(grid, std::move(targets));
    c.request.result = ResultKind::kBuckets;
    return c;
  };
  TargetSpec checker;
  checker.shader = {"checker", {}};
  add_buckets(narrow, {TargetSpec()});
  add_buckets(narrow, {TargetSpec()}).slab_depth = 80;
  add_buckets(slanted, {greatest});
  add_buckets(slanted, {checker, sum(VoxelFormat::kF32, 3, 0)});
  add_buckets(parts_of_rows, {checker});
  // Rows of more voxels of a triangle than a lane sorts, of both coverages; and grids that only some of the largest
  // reach, or none of any.
  add_buckets(parts_of_rows, {TargetSpec()});
  add_buckets(parts_of_rows, {TargetSpec()});
  // The longest rows whose voxels fit the codes that a lane sorts, and longer ones.
  for (const int64_t row : {2048, 2049}) {
    add_buckets(Placed({row, 96, 90}, {110.0 - double(row), 10, 20}, {1, 1.02, 1}), {TargetSpec()});
  }
  for (const double away : {30.0, 60.0, 500.0}) {
    add_buckets(Placed({40, 120, 100}, {away, away, away}, {0.2, 0.2, 0.2}), {TargetSpec()});
    add_buckets(Placed({40, 120, 100}, {away, away, away}, {0.2, 0.2, 0.2}), {checker});
  }
  return cases;
}

}  // namespace voxelpipe::gpu
