// Fills by parts against their definition, over random assemblies: who contains a centre, who owns a voxel, what each
// blend then holds.
#include <random>
#include <string>
#include <vector>

#include "oracle/parts/assembly.h"
#include "oracle/parts/parts_reference.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

TargetSpec Target(VoxelFormat format, int components, Blend blend, const char* shader, double clear = 0,
                  std::vector<double> fill = {}) {
  TargetSpec target = TargetOf(format, components, blend, {shader, {}});
  target.clear = clear;
  target.fill_values = std::move(fill);
  return target;
}

// Shaders of all kinds: those that the part decides, those that the place decides, those that need a triangle; and
// single targets, which have ways of their own.
constexpr size_t kTargetSets = 7, kSetOfVelocities = 2;

TargetSpec Srgb(TargetSpec target) {
  target.encoding = Encoding::kSrgb;
  return target;
}

std::vector<TargetSpec> TargetSet(size_t number) {
  using enum VoxelFormat;
  using enum Blend;
  switch (number % kTargetSets) {
    case 0:
      return {Target(kBit, 1, kOr, "occupancy"),
              Target(kU32, 1, kReplace, "label", 77),
              Target(kU32, 1, kReplace, "triangle_id", 4e9),
              Target(kU16, 1, kReplace, "material_id", 99),
              Target(kU32, 1, kFirst, "triangle_id", 4e9),
              Target(kU32, 1, kMax, "label"),
              Target(kF32, 3, kReplace, "position", -1),
              Target(kU8, 4, kReplace, "base_color", 3)};
    case 1:
      return {Target(kU32, 1, kCount, "occupancy", 5),           Target(kU32, 1, kMin, "label", 9, {500}),
              Target(kU8, 1, kReplace, "mesh_id", 255, {200}),   Target(kBit, 1, kReplace, "mesh_id"),
              Target(kF16, 2, kReplace, "constant", 0.5),        Target(kU16, 1, kAdd, "label", 1),
              Target(kU16, 2, kMax, "metallic_roughness", 1000), Target(kF32, 3, kReplace, "emissive", 2)};
    case kSetOfVelocities:
      return {Target(kU8, 1, kOr, "label"),
              Target(kF32, 3, kMax, "position", 8),
              Target(kU32, 1, kFirst, "label"),
              Target(kU8, 1, kReplace, "checker", 9),
              Target(kF32, 3, kReplace, "velocity", -1),
              Target(kU16, 1, kAnd, "label"),
              Target(kBit, 1, kFirst, "material_id", 1),
              Target(kF32, 3, kReplace, "geometric_normal", 4, {1, 2, 3})};
    case 3:
      return {Target(kBit, 1, kReplace, "occupancy", 0, {0}),
              Target(kBit, 1, kReplace, "occupancy"),
              Srgb(Target(kU8, 4, kReplace, "base_color", 17)),
              Target(kF16, 1, kReplace, "label", 0.25),
              Target(kF32, 1, kMin, "label", -1),
              Target(kU32, 1, kAnd, "material_id", 6),
              Target(kF32, 3, kReplace, "barycentric", -0.5),
              Target(kBit, 1, kCount, "triangle_id", 1)};
    case 4: return {Target(kBit, 1, kOr, "occupancy")};
    case 5: return {Target(kBit, 1, kReplace, "occupancy", 0, {0})};
    default: return {Target(kU8, 1, kReplace, "label")};
  }
}

PartSelection RandomSelection(PartScope scope, std::mt19937& random) {
  constexpr const char* kPatterns[] = {"hull", "leg*", "*", "?eg", "b?x", "", "*t", "leg_left", "**u*l", "none"};
  const auto whole = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  const auto pattern = [&] { return std::string(kPatterns[whole(0, int(std::size(kPatterns)) - 1)]); };
  PartSelection selection;
  selection.scope = scope;
  if (scope == PartScope::kWhole) return selection;
  for (int i = whole(0, 3); i > 0; --i) selection.labels.push_back({pattern(), whole(1, 255)});
  for (int i = whole(0, 3); i > 0; --i) selection.priorities.push_back({pattern(), whole(-2, 2)});
  if (whole(0, 3) == 0) selection.priorities.push_back({pattern(), INT32_MIN});
  if (whole(0, 3) == 0) selection.priorities.push_back({pattern(), INT32_MAX});
  return selection;
}

GridRequest GridOf(uint32_t seed, double extent) {
  const auto n = int64_t(extent);
  GridRequest grid = UnitGrid(n, n - 3, n + 2);
  if (seed % 4 == 1) {  // voxels that are no cubes
    grid.dims = {n + 1, n / 2, n - 1};
    grid.voxel_size = Vec3d{1, 2, 0.75};
    grid.origin = Vec3d{-0.25, -1, 0.5};
  } else if (seed % 4 == 2) {
    grid = {};
    grid.resolution = n;
    grid.fit = seed % 8 == 2 ? GridFit::kTight : GridFit::kCube;
  }
  return grid;
}

constexpr PartScope kScopes[] = {PartScope::kWhole, PartScope::kFile, PartScope::kNode, PartScope::kMesh,
                                 PartScope::kMaterial};
constexpr Coverage kCoverages[] = {Coverage::kNone, Coverage::kThin, Coverage::kConservative, Coverage::kCenter};

// Every scope with every coverage, the other choices taking turns.
void ExpectAllByParts(const AssemblyKind& kind) {
  const Assembly assembly = RandomAssembly(kind);
  std::mt19937 random(kind.seed + 1000);
  VoxelizeRequest request;
  request.grid = GridOf(kind.seed, kind.extent);
  request.targets = TargetSet(kind.moves ? kSetOfVelocities : kind.seed);
  request.layout = kind.seed % 5 == 0 ? Layout::kPlanar : Layout::kInterleaved;
  request.coverage = Coverage::kConservative;
  const GridSpec grid = RunPipeline(assembly.mesh, request).grid;
  const Solids solids(assembly, grid);
  double decided = 0;
  int runs = 0;
  for (const Coverage coverage : kCoverages) {
    request.coverage = coverage;
    const Fragments fragments(assembly, request);
    for (const PartScope scope : kScopes) {
      request.parts = RandomSelection(scope, random);
      request.fill = (kind.seed + uint32_t(runs)) % 2 == 0 ? Fill::kParity : Fill::kNonzero;
      request.result = random() % 2 == 0 ? ResultKind::kDense : ResultKind::kSparse;
      const std::string what = "seed " + std::to_string(kind.seed) + ", " + std::string(Name(coverage)) + ", parts " +
                               std::string(Name(scope)) + ", " + std::string(Name(request.fill)) + ", " +
                               std::string(Name(request.result));
      decided += ExpectByParts(assembly, solids, fragments, request, grid, what);
      ++runs;
      if (::testing::Test::HasFailure()) return;
    }
  }
  EXPECT_GT(decided / runs, 0.5) << "seed " << kind.seed;
}

AssemblyKind KindOf(uint32_t seed) {
  constexpr int kBodies[] = {2, 3, 5, 8, 13, 30, 60};
  constexpr double kExtents[] = {12, 16, 20, 24, 28};
  AssemblyKind kind;
  kind.seed = seed;
  kind.bodies = kBodies[seed % std::size(kBodies)];
  kind.extent = kExtents[seed % std::size(kExtents)];
  kind.colors = seed % kTargetSets == 0 || seed % kTargetSets == 3;  // with the targets that read them
  return kind;
}

TEST(PartsOracleTest, ThePartsOfOneMesh) {
  for (uint32_t seed = 1; seed <= 18; ++seed) ExpectAllByParts(KindOf(seed));
}

TEST(PartsOracleTest, PlacedMeshes) {
  for (uint32_t seed = 101; seed <= 118; ++seed) {
    AssemblyKind kind = KindOf(seed);
    kind.placed = true;
    ExpectAllByParts(kind);
  }
}

TEST(PartsOracleTest, PlacedMeshesThatMove) {
  for (uint32_t seed = 201; seed <= 206; ++seed) {
    AssemblyKind kind = KindOf(seed);
    kind.placed = kind.moves = true;
    ExpectAllByParts(kind);
  }
}

// What a mask discards is no fragment of the target.
TEST(PartsOracleTest, MaskedParts) {
  for (uint32_t seed = 400; seed <= 421; ++seed) {
    if (TargetSet(seed).size() == 1 || seed % kTargetSets == kSetOfVelocities) continue;  // these read no material
    AssemblyKind kind = KindOf(seed);
    kind.placed = seed % 2 == 0;
    kind.masks = true;
    ExpectAllByParts(kind);
  }
}

// Odd columns of one part change nothing of other parts.
TEST(PartsOracleTest, OpenParts) {
  for (uint32_t seed = 301; seed <= 310; ++seed) {
    AssemblyKind kind = KindOf(seed);
    kind.placed = seed % 2 == 0;
    kind.open = true;
    ExpectAllByParts(kind);
  }
}

// The two ways of the reference to tell who contains a centre agree.
TEST(PartsOracleTest, CrossingsCountWindings) {
  for (uint32_t seed = 1; seed <= 7; ++seed) {
    const AssemblyKind kind = KindOf(seed);
    const Assembly assembly = RandomAssembly(kind);
    GridSpec grid;
    grid.dims = {15, 14, 13};
    const Solids solids(assembly, grid);
    std::vector<std::vector<size_t>> lists(1);
    for (size_t b = 0; b < assembly.bodies.size(); ++b) lists[0].push_back(b), lists.push_back({b});
    for (const auto& bodies : lists) {
      for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
        const std::vector<Inside> by_winding = solids.Of(bodies, fill), by_crossings = solids.ByCrossings(bodies, fill);
        for (size_t n = 0; n < by_winding.size(); ++n) {
          if (by_winding[n] == Inside::kUnsure || by_crossings[n] == Inside::kUnsure) continue;
          ASSERT_EQ(by_winding[n], by_crossings[n]) << "seed " << seed << ", voxel " << n;
        }
      }
    }
  }
}

}  // namespace
}  // namespace voxelpipe
