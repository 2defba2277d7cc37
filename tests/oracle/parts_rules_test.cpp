// Rules of parts by small cases, each of a few boxes.
#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "mesh/parts/part_list.h"
#include "mesh/placed_mesh.h"
#include "oracle/parts/assembly.h"
#include "oracle/parts/parts_reference.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;
using ::testing::HasSubstr;

TaggedBody Node(const Body& body, uint32_t node, int32_t material = -1) {
  TaggedBody tagged;
  tagged.body = body;
  tagged.node = tagged.instance = node;
  tagged.material = material;
  tagged.node_name = "n" + std::to_string(node);
  return tagged;
}

VoxelizeRequest NodesOf(const GridRequest& grid, Fill fill, std::vector<TargetSpec> targets) {
  VoxelizeRequest request;
  request.grid = grid;
  request.fill = fill;
  request.parts.scope = PartScope::kNode;
  request.targets = std::move(targets);
  return request;
}

TargetSpec LabelTarget(Blend blend) {
  return TargetOf(VoxelFormat::kU32, 1, blend, {"label", {}});
}

// Parts by ascending rank: blue, green, and one whose mask discards it.
TriangleMesh WithAMask(const Body& blue, const Body& green, const Body& masked) {
  std::vector<Material> materials(3);
  materials[0].base_color_factor = {0, 0, 1, 1};
  materials[1].base_color_factor = {0, 1, 0, 1};
  materials[2].base_color_factor = {1, 0, 0, 0};
  materials[2].alpha_mode = AlphaMode::kMask;
  return WriteMesh({Node(blue, 0, 0), Node(green, 1, 1), Node(masked, 2, 2)}, materials);
}

// Of voxel (1,1,1): beside the centre, with a fragment; around the whole voxel, without one; away from it; both around
// the centre and with a fragment.
Body Beside(double low) {
  return Box({low, 1.2, 1.2}, {low + 1, 1.8, 1.8});
}
Body Around() {
  return Box({-5, -5, -5}, {8, 8, 8});
}
Body Away() {
  return Box({30, 30, 30}, {31, 31, 31});
}
Body Through() {
  return Box({1.2, 1.2, 1.2}, {4, 4, 4});
}

constexpr uint64_t kMiddle = 1 + 3 * (1 + 3 * 1);
using Color = std::vector<int>;

Color ColorAt(const VoxelizeResult& result, uint64_t voxel) {
  const uint8_t* const v = result.targets[0].data() + 4 * voxel;
  return {v[0], v[1], v[2], v[3]};
}

// Base colours, and beside them labels, which no mask discards.
VoxelizeResult Colors(const TriangleMesh& mesh, bool labels) {
  auto request =
      NodesOf(UnitGrid(3, 3, 3), Fill::kParity, {TargetOf(VoxelFormat::kU8, 4, Blend::kReplace, {"base_color", {}})});
  request.targets[0].clear = 7;
  if (labels) request.targets.push_back(LabelTarget(Blend::kReplace));
  return RunPipeline(mesh, request);
}

const Color kBlue = {0, 0, 255, 255}, kGreen = {0, 255, 0, 255}, kClear = {7, 7, 7, 7};

// A fragment that every target discards does not happen: it takes nothing from the part that contains the centre.
TEST(PartsRulesTest, ADiscardedFragmentOwnsNothing) {
  EXPECT_EQ(ColorAt(Colors(WithAMask(Beside(1.8), Around(), Beside(0.2)), false), kMiddle), kGreen);
  EXPECT_EQ(ColorAt(Colors(WithAMask(Away(), Around(), Beside(0.2)), false), kMiddle), kGreen);
  EXPECT_EQ(ColorAt(Colors(WithAMask(Beside(1.8), Away(), Beside(0.2)), false), kMiddle), kBlue);
}

// Where another target keeps it, its part owns the voxel there; here that is left open, but a part below one that
// contains the centre does not show.
TEST(PartsRulesTest, ADiscardedFragmentShowsNoneOfALowerPart) {
  const VoxelizeResult result = Colors(WithAMask(Beside(1.8), Around(), Beside(0.2)), true);
  EXPECT_EQ(ValueAt<uint32_t>(result.targets[1], kMiddle), 3u);
  EXPECT_NE(ColorAt(result, kMiddle), kBlue);
}

// A masked part that contains the centre hides those below it, whether it has fragments there or not.
TEST(PartsRulesTest, AMaskedPartHidesThoseBelow) {
  for (const bool labels : {false, true}) {
    EXPECT_EQ(ColorAt(Colors(WithAMask(Beside(1.8), Away(), Around()), labels), kMiddle), kClear);
    EXPECT_EQ(ColorAt(Colors(WithAMask(Away(), Around(), Around()), labels), kMiddle), kClear);
    EXPECT_EQ(ColorAt(Colors(WithAMask(Beside(1.8), Away(), Through()), labels), kMiddle), kClear);
  }
}

// The inside of what a mask discards holds `clear`.
TEST(PartsRulesTest, AMaskedPartIsClearInside) {
  std::vector<Material> materials(1);
  materials[0].base_color_factor = {1, 1, 1, 0.25f};
  materials[0].alpha_mode = AlphaMode::kMask;
  auto request =
      NodesOf(UnitGrid(5, 5, 5), Fill::kNonzero, {TargetOf(VoxelFormat::kU8, 4, Blend::kReplace, {"base_color", {}})});
  request.targets[0].clear = 7;
  const VoxelizeResult result = RunPipeline(WriteMesh({Node(Box({1, 1, 1}, {4, 4, 4}), 0, 0)}, materials), request);
  EXPECT_EQ(result.stats.occupied, 27u);
  for (uint64_t n = 0; n < 125; ++n) EXPECT_EQ(ColorAt(result, n), kClear);
}

TEST(PartsRulesTest, AMeshWithoutTrianglesIsClear) {
  const TriangleMesh mesh = WriteMesh({Node({.positions = {{1, 1, 1}}, .triangles = {}}, 0)}, {});
  for (const PartScope scope : {PartScope::kFile, PartScope::kNode, PartScope::kMesh, PartScope::kMaterial}) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      auto request = NodesOf(UnitGrid(5, 5, 5), Fill::kParity, {LabelTarget(Blend::kReplace), TargetSpec{}});
      request.parts.scope = scope;
      request.result = kind;
      const VoxelizeResult result = RunPipeline(mesh, request);
      EXPECT_EQ(result.stats.occupied, 0u);
      for (uint64_t n = 0; n < result.targets[0].size(); ++n) EXPECT_EQ(result.targets[0].data()[n], 0);
    }
  }
}

TEST(PartsRulesTest, WithoutAFillTheyChangeOnlyLabels) {
  AssemblyKind kind;
  kind.seed = 3;
  kind.bodies = 13;
  const Assembly assembly = RandomAssembly(kind);
  for (const PartScope scope : {PartScope::kFile, PartScope::kNode, PartScope::kMesh, PartScope::kMaterial}) {
    for (const ResultKind kind_of : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
      VoxelizeRequest whole;
      whole.grid = UnitGrid(16, 15, 17);
      whole.result = kind_of;
      whole.targets = {TargetSpec{}, TargetOf(VoxelFormat::kU32, 1, Blend::kReplace, {"triangle_id", {}}),
                       TargetOf(VoxelFormat::kU32, 1, Blend::kFirst, {"material_id", {}}),
                       LabelTarget(Blend::kReplace)};
      VoxelizeRequest parts = whole;
      parts.parts.scope = scope;
      parts.parts.labels = {{"hull", 70'000}};
      parts.parts.priorities = {{"leg*", 5}};
      const VoxelizeResult a = RunPipeline(assembly.mesh, whole), b = RunPipeline(assembly.mesh, parts);
      EXPECT_EQ(a.stats.occupied, b.stats.occupied);
      EXPECT_EQ(a.stats.fragments, b.stats.fragments);
      const auto old_arrays = ArraysOf(a), new_arrays = ArraysOf(b);
      ASSERT_EQ(old_arrays.size(), HeaderOf(b).first_part_array());
      for (size_t i = 0; i + 1 < old_arrays.size(); ++i) {
        EXPECT_TRUE(std::ranges::equal(old_arrays[i], new_arrays[i])) << i;
      }
      // A triangle's label, wherever triangle_id tells the triangle.
      const ReferenceParts cut = CutParts(assembly, parts.parts);
      std::vector<uint32_t> labels;
      for (size_t body = 0; body < assembly.bodies.size(); ++body) {
        labels.insert(labels.end(), assembly.bodies[body].body.triangles.size(), cut.parts[cut.of_body[body]].label);
      }
      for (uint64_t n = 0; n < b.targets[3].size() / 4; ++n) {
        if (kind_of == ResultKind::kDense && !BitAt(b.targets[0], n)) continue;
        ASSERT_EQ(ValueAt<uint32_t>(b.targets[3], n), labels[ValueAt<uint32_t>(b.targets[1], n)]);
      }
    }
  }
}

// Where all priorities differ, ranks and with them owners do not depend on the order of the list.
TEST(PartsRulesTest, DistinctPrioritiesMakeTheOrderOfTheListIrrelevant) {
  AssemblyKind kind;
  kind.seed = 17;
  kind.bodies = 8;
  const Assembly assembly = RandomAssembly(kind);
  std::vector<PlacedMesh> list;
  for (size_t b = 0; b < assembly.bodies.size(); ++b) {
    PlacedMesh& placed = list.emplace_back();
    TaggedBody alone;
    alone.body = assembly.bodies[b].body;
    placed.mesh = std::make_shared<const TriangleMesh>(WriteMesh({alone}, {}));
    placed.label = uint32_t(b + 10);
    placed.priority = int32_t(b * 7 % 8) - 4;
  }
  for (const Coverage coverage : {Coverage::kNone, Coverage::kConservative}) {
    for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
      VoxelizeRequest request;
      request.grid = UnitGrid(16, 15, 17);
      request.coverage = coverage;
      request.fill = fill;
      request.parts.scope = PartScope::kFile;
      request.targets = {LabelTarget(Blend::kReplace), LabelTarget(Blend::kMax)};
      request.targets[1].fill_values = {3};
      std::vector<std::vector<uint8_t>> labels;
      for (int turn = 0; turn < 4; ++turn) {
        std::rotate(list.begin(), list.begin() + 3, list.end());
        if (turn == 2) std::reverse(list.begin(), list.end());
        const JobContext job;
        const auto mesh = PlaceMeshes(job, list);
        ASSERT_TRUE(mesh.ok()) << mesh.status();
        const VoxelizeResult result = RunPipeline(*mesh, request);
        std::vector<uint8_t> both = Bytes(result.targets[0]);
        const std::vector<uint8_t> most = Bytes(result.targets[1]);
        both.insert(both.end(), most.begin(), most.end());
        labels.push_back(both);
        EXPECT_EQ(labels.back(), labels.front());
      }
    }
  }
}

// Parts that are left out are as parts that are not there.
TEST(PartsRulesTest, WhatIsExcludedLeavesNoTrace) {
  AssemblyKind kind;
  kind.seed = 12;
  kind.bodies = 30;
  const Assembly assembly = RandomAssembly(kind);
  for (const PartScope scope : {PartScope::kNode, PartScope::kMesh}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(16, 15, 17);
    request.fill = Fill::kNonzero;
    request.parts.scope = scope;
    request.parts.exclude = {"hull", "*x"};
    request.parts.priorities = {{"leg", 1}};
    request.targets = {LabelTarget(Blend::kReplace),
                       TargetOf(VoxelFormat::kU32, 1, Blend::kReplace, {"triangle_id", {}}),
                       TargetOf(VoxelFormat::kU32, 1, Blend::kReplace, {"mesh_id", {}}),
                       TargetOf(VoxelFormat::kU8, 4, Blend::kReplace, {"base_color", {}})};
    std::vector<TaggedBody> left;
    for (const TaggedBody& tagged : assembly.bodies) {
      const std::string& name = scope == PartScope::kNode ? tagged.node_name : tagged.mesh_name;
      if (name != "hull" && !name.ends_with('x')) left.push_back(tagged);
    }
    ASSERT_LT(left.size(), assembly.bodies.size());
    const JobContext job;
    const auto rest = ExcludeParts(job, assembly.mesh, request.parts);
    ASSERT_TRUE(rest.ok()) << rest.status();
    const VoxelizeResult a = RunPipeline(*rest, request);
    request.parts.exclude.clear();
    const VoxelizeResult b = RunPipeline(WriteMesh(left, assembly.materials), request);
    for (size_t t = 0; t < a.targets.size(); ++t) EXPECT_EQ(Bytes(a.targets[t]), Bytes(b.targets[t])) << t;
  }
}

TEST(PartsRulesTest, RequestsThatMakeNoSenseAreRefused) {
  const TriangleMesh mesh = WriteMesh({Node(Box({1, 1, 1}, {3, 3, 3}), 0), Node(Box({2, 2, 2}, {4, 4, 4}), 1)}, {});
  const auto with = [&](VoxelFormat format, int64_t label, Fill fill = Fill::kParity) {
    auto request = NodesOf(UnitGrid(5, 5, 5), fill, {TargetOf(format, 1, Blend::kReplace, {"label", {}})});
    request.parts.labels = {{"n1", label}};
    return RunError(mesh, request);
  };
  EXPECT_EQ(with(VoxelFormat::kU32, 5, Fill::kFlood).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(with(VoxelFormat::kU8, 255).ok());
  EXPECT_TRUE(with(VoxelFormat::kF16, 2048).ok());
  EXPECT_TRUE(with(VoxelFormat::kF32, 1 << 24).ok());
  EXPECT_TRUE(with(VoxelFormat::kU32, UINT32_MAX).ok());
  const auto says = [&](VoxelFormat format, int64_t label, const std::string& smallest) {
    const absl::Status refused = with(format, label);
    EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument) << label;
    EXPECT_THAT(std::string(refused.message()), HasSubstr(smallest)) << label;
  };
  says(VoxelFormat::kU8, 256, "16");
  says(VoxelFormat::kF16, 2049, "u16");
  says(VoxelFormat::kU16, 65'536, "f32");
  says(VoxelFormat::kF32, (1 << 24) + 1, "u32");
  says(VoxelFormat::kU32, 0, "label");
}

}  // namespace
}  // namespace voxelpipe
