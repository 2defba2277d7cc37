// Each kernel once or twice on a small mesh.
#include <utility>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

std::vector<ParityCase> QuickCases(const ParityMesh& named) {
  const GridRequest grid = GridsFor(named.extent)[0];
  std::vector<ParityCase> cases;
  const auto add = [&](ResultKind kind, Coverage coverage, Fill fill, std::vector<TargetSpec> targets) -> ParityCase& {
    ParityCase c;
    c.request.grid = grid;
    c.request.result = kind;
    c.request.coverage = coverage;
    c.request.fill = fill;
    c.request.targets = std::move(targets);
    cases.push_back(c);
    return cases.back();
  };
  const auto target = [](VoxelFormat format, int components, Blend blend, const char* shader) {
    TargetSpec t;
    t.format = format;
    t.components = components;
    t.blend = blend;
    t.shader = {shader, {}};
    return t;
  };
  const TargetSpec bit, f32_max = target(VoxelFormat::kF32, 1, Blend::kMax, "triangle_id");
  const TargetSpec f32_add = target(VoxelFormat::kF32, 1, Blend::kAdd, "coverage_fraction");
  const TargetSpec f32x4 = target(VoxelFormat::kF32, 4, Blend::kAverage, "normal");
  // Shaders that discard, all widths of element, all kinds of accumulator.
  const std::vector<TargetSpec> many = {target(VoxelFormat::kU8, 4, Blend::kMax, "base_color"),
                                        target(VoxelFormat::kU16, 1, Blend::kReplace, "packed_normal"),
                                        target(VoxelFormat::kU32, 1, Blend::kCount, "occupancy"),
                                        target(VoxelFormat::kF16, 3, Blend::kMin, "position"),
                                        target(VoxelFormat::kBit, 1, Blend::kAnd, "checker"),
                                        target(VoxelFormat::kU32, 1, Blend::kFirst, "triangle_id"),
                                        target(VoxelFormat::kBit, 1, Blend::kOr, "base_color")};
  add(ResultKind::kDense, Coverage::kConservative, Fill::kNone, {bit});
  add(ResultKind::kDense, Coverage::kThin, Fill::kParity, {bit});
  add(ResultKind::kDense, Coverage::kCenter, Fill::kFlood, {bit});
  add(ResultKind::kSparse, Coverage::kThin, Fill::kParity, {bit});
  add(ResultKind::kDense, Coverage::kThin, Fill::kNone, {f32_max});
  ParityCase& ids = add(ResultKind::kDense, Coverage::kConservative, Fill::kNone,
                        {target(VoxelFormat::kU32, 1, Blend::kMax, "triangle_id")});
  ids.request.grid = GridsFor(named.extent)[6];  // of odd sides
  ids.slab_depth = 8;
  add(ResultKind::kDense, Coverage::kConservative, Fill::kNone, {f32_add});
  add(ResultKind::kDense, Coverage::kConservative, Fill::kParity, {f32x4}).request.layout = Layout::kPlanar;
  add(ResultKind::kDense, Coverage::kThin, Fill::kFlood, many).slab_depth = 8;
  add(ResultKind::kSparse, Coverage::kConservative, Fill::kNone, {f32_max});
  // Owners: of all layouts and widths, in slabs, and where no fragment of a voxel stays.
  add(ResultKind::kDense, Coverage::kThin, Fill::kNone, {target(VoxelFormat::kF32, 3, Blend::kReplace, "normal")})
      .request.layout = Layout::kPlanar;
  add(ResultKind::kDense, Coverage::kConservative, Fill::kNone, {target(VoxelFormat::kU8, 4, Blend::kFirst, "uv")})
      .slab_depth = 8;
  add(ResultKind::kSparse, Coverage::kConservative, Fill::kNone,
      {target(VoxelFormat::kU16, 2, Blend::kFirst, "position")});
  add(ResultKind::kSparse, Coverage::kConservative, Fill::kNone,
      {target(VoxelFormat::kF16, 1, Blend::kReplace, "base_color")});
  add(ResultKind::kSparse, Coverage::kConservative, Fill::kParity, many);
  // Parts that are filled each by itself: owners, ids and values of triangles, fragments.
  const std::vector<TargetSpec> of_parts = {bit,
                                            target(VoxelFormat::kU16, 1, Blend::kReplace, "label"),
                                            target(VoxelFormat::kU32, 1, Blend::kFirst, "triangle_id"),
                                            target(VoxelFormat::kF32, 1, Blend::kMax, "triangle_id"),
                                            target(VoxelFormat::kF32, 3, Blend::kAverage, "normal"),
                                            target(VoxelFormat::kU16, 1, Blend::kAdd, "material_id"),
                                            target(VoxelFormat::kU8, 4, Blend::kReplace, "base_color")};
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kNone}) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      ParityCase& c = add(kind, coverage, cases.size() % 2 == 0 ? Fill::kParity : Fill::kNonzero, of_parts);
      c.request.parts.scope = PartScope::kMaterial;
      c.slab_depth = kind == ResultKind::kDense ? 8 : 0;
    }
  }
  add(ResultKind::kBuckets, Coverage::kConservative, Fill::kNone, {bit});
  add(ResultKind::kBuckets, Coverage::kThin, Fill::kNone, many).request.layout = Layout::kPlanar;
  return cases;
}

}  // namespace voxelpipe::gpu
