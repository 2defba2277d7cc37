// Requests for parts give the same bytes whatever the instruction set, the number of threads, the slabs and the way of
// delivery.
#include <array>
#include <string>
#include <vector>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "mesh/parts/part_list.h"
#include "oracle/parts/assembly.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

struct Way {
  SimdChoice simd = SimdChoice::kScalar;
  int threads = 1;
  PlanLimits limits;
  bool streamed = false;
};

std::string CountsOf(const VoxelizeStats& stats) {
  return std::to_string(stats.occupied) + " occupied, " + std::to_string(stats.odd_columns.value_or(0)) + " odd";
}

// The arrays, and the counts as one more.
Arrays BytesOf(const TriangleMesh& mesh, VoxelizeRequest request, const Way& way) {
  request.simd = way.simd;
  request.threads = way.threads;
  const JobContext job;
  Arrays arrays;
  std::string counts;
  if (way.streamed) {
    KeepArrays sink;
    const auto stats = VoxelizeTo(mesh, request, {job, way.limits}, sink);
    EXPECT_TRUE(stats.ok()) << stats.status();
    if (!stats.ok()) return arrays;
    arrays = sink.arrays;
    counts = CountsOf(*stats);
  } else {
    const auto result = Voxelize(mesh, request, {job, way.limits});
    EXPECT_TRUE(result.ok()) << result.status();
    if (!result.ok()) return arrays;
    arrays = CopyArrays(*result);
    counts = CountsOf(result->stats);
  }
  arrays.emplace_back(counts.begin(), counts.end());
  return arrays;
}

std::vector<Way> Ways() {
  PlanLimits thin, deep, small;
  thin.slab_depth = 8;
  deep.slab_depth = 16;
  small.slab_bytes = 20'000;
  std::vector<Way> ways = {
      {SimdChoice::kScalar, 2, thin, true}, {SimdChoice::kScalar, 3, {}, false}, {SimdChoice::kScalar, 1, small, true}};
  for (const SimdChoice simd : {SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    if (!cpu::SelectRowKernels(simd).ok()) continue;
    ways.push_back({simd, 1, {}, false});
    ways.push_back({simd, 2, thin, false});
    ways.push_back({simd, 2, deep, true});
  }
  return ways;
}

std::vector<std::vector<TargetSpec>> TargetSets() {
  using enum VoxelFormat;
  using enum Blend;
  return {{TargetSpec{}},
          {TargetOf(kU8, 1, kReplace, {"label", {}})},
          {TargetOf(kU32, 1, kReplace, {"triangle_id", {}}), TargetOf(kU32, 1, kFirst, {"label", {}}),
           TargetOf(kF32, 3, kReplace, {"position", {}}), TargetOf(kF32, 2, kAdd, {"barycentric", {}}),
           TargetOf(kU8, 4, kReplace, {"base_color", {}}), TargetOf(kBit, 1, kReplace, {"material_id", {}}),
           TargetOf(kF32, 3, kReplace, {"velocity", {}}), TargetOf(kU16, 1, kMax, {"label", {}})}};
}

TEST(PartBytes, AreTheSameInEveryWayOfRunning) {
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    AssemblyKind kind;
    kind.seed = seed + 500;
    kind.bodies = seed % 2 == 0 ? 40 : 9;
    kind.extent = 38;  // over tiles and words, no multiple of anything
    kind.placed = seed % 3 == 0;
    kind.moves = seed % 3 == 0;
    kind.open = seed % 4 == 1;
    kind.masks = seed % 4 == 2;
    const Assembly assembly = RandomAssembly(kind);
    int turn = 0;
    for (const auto& targets : TargetSets()) {
      for (const PartScope scope : {PartScope::kFile, PartScope::kNode, PartScope::kMaterial}) {
        VoxelizeRequest request;
        request.grid = UnitGrid(39, 37, 35);
        request.targets = targets;
        request.parts.scope = scope;
        request.parts.priorities = {{"leg*", 2}, {"", -1}};
        ++turn;
        request.fill = (uint32_t(turn) + seed) % 2 == 0 ? Fill::kParity : Fill::kNonzero;
        request.result = turn % 4 < 2 ? ResultKind::kDense : ResultKind::kSparse;
        request.layout = turn % 5 == 0 ? Layout::kPlanar : Layout::kInterleaved;
        request.coverage = std::array{Coverage::kConservative, Coverage::kThin, Coverage::kNone,
                                      Coverage::kCenter}[(uint32_t(turn) + seed) % 4];
        const Arrays plain = BytesOf(assembly.mesh, request, Way{});
        ASSERT_FALSE(plain.empty());
        for (const Way& way : Ways()) {
          ASSERT_EQ(BytesOf(assembly.mesh, request, way), plain)
              << "seed " << seed << ", request " << turn << ", " << Name(way.simd) << ", " << way.threads
              << " threads, slabs of " << way.limits.slab_depth << (way.streamed ? ", streamed" : "");
        }
      }
    }
  }
}

// A large grid, over which single triangles cross many lines: each voxel is in the part of the highest rank among those
// that fill it when each is alone.
TEST(PartBytes, AreThoseOfEachPartAlone) {
  AssemblyKind kind;
  kind.seed = 77;
  kind.bodies = 16;
  kind.extent = 150;
  kind.open = true;
  const Assembly assembly = RandomAssembly(kind);
  VoxelizeRequest request;
  request.grid = UnitGrid(157, 131, 145);
  request.coverage = Coverage::kNone;
  for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
    request.fill = fill;
    request.parts = {};
    request.targets = {TargetSpec{}};
    const JobContext job;
    PartSelection nodes;
    nodes.scope = PartScope::kNode;
    const auto list = ListParts(job, assembly.mesh, nodes);
    ASSERT_TRUE(list.ok());
    ASSERT_GT(list->parts.size(), 3u);
    std::vector<uint8_t> owners(157 * 131 * 145);
    uint64_t odd = 0;
    for (uint32_t part = 0; part < list->parts.size(); ++part) {  // of equal priority: ranked by number
      TriangleMesh alone = assembly.mesh;
      alone.triangles.clear();
      for (size_t run = 0; run < alone.parts.size(); ++run) {
        MeshPart& of = alone.parts[run];
        const auto from = assembly.mesh.triangles.begin() + ptrdiff_t(of.first_triangle);
        of.first_triangle = alone.triangles.size();
        if (list->of_run[run] != part) of.triangle_count = 0;
        alone.triangles.insert(alone.triangles.end(), from, from + ptrdiff_t(of.triangle_count));
      }
      const VoxelizeResult inside = RunPipeline(alone, request);
      odd += inside.stats.odd_columns.value_or(0);
      for (uint64_t n = 0; n < owners.size(); ++n) {
        if (BitAt(inside.targets[0], n)) owners[n] = uint8_t(part + 1);
      }
    }
    request.parts = nodes;
    request.targets = {TargetOf(VoxelFormat::kU8, 1, Blend::kReplace, {"label", {}})};
    const VoxelizeResult together = RunPipeline(assembly.mesh, request);
    EXPECT_EQ(Bytes(together.targets[0]), owners) << Name(fill);
    EXPECT_EQ(together.stats.odd_columns, odd) << "counted once for each part";
  }
}

}  // namespace
}  // namespace voxelpipe
