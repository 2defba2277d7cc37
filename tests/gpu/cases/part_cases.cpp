#include "gpu/cases/part_cases.h"

#include <array>
#include <random>
#include <utility>

#include "oracle/parts/assembly.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

using testing::AssemblyKind;
using testing::TaggedBody;

TargetSpec Target(VoxelFormat format, int components, Blend blend, const char* shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = blend;
  target.shader = {shader, {}};
  return target;
}

std::vector<std::vector<TargetSpec>> TargetSets() {
  using enum VoxelFormat;
  using enum Blend;
  TargetSpec no_fill = Target(kBit, 1, kReplace, "occupancy"), cleared = Target(kU8, 3, kReplace, "base_color");
  no_fill.fill_values = {0};
  cleared.clear = 7;
  TargetSpec given = Target(kU16, 1, kReplace, "label");
  given.fill_values = {999};
  return {{TargetSpec{}},
          {Target(kU16, 1, kReplace, "label")},
          {Target(kU32, 1, kReplace, "triangle_id"), Target(kU32, 1, kFirst, "label"),
           Target(kF32, 3, kReplace, "position"), Target(kF32, 2, kAdd, "barycentric"),
           Target(kU8, 4, kReplace, "base_color"), Target(kBit, 1, kReplace, "material_id"),
           Target(kF32, 3, kReplace, "velocity"), Target(kU16, 1, kMax, "label")},
          {Target(kU32, 1, kFirst, "triangle_id")},
          {Target(kF32, 1, kMax, "triangle_id")},
          {no_fill, TargetSpec{}},
          {cleared},
          {Target(kU8, 3, kAverage, "base_color"), Target(kU32, 1, kMin, "mesh_id"), Target(kU32, 1, kOr, "label")},
          {Target(kF32, 4, kMax, "normal")},
          {Target(kU32, 1, kCount, "occupancy"), Target(kF16, 3, kFirst, "position"), Target(kBit, 1, kAnd, "checker")},
          {given, Target(kU8, 4, kFirst, "base_color"), Target(kF32, 1, kMin, "triangle_id")}};
}

// Bodies, each a node and a mesh of its own; every third one has the second of two materials.
TriangleMesh Bodies(const std::vector<testing::Body>& bodies) {
  std::vector<TaggedBody> tagged(bodies.size());
  for (uint32_t i = 0; i < bodies.size(); ++i) {
    tagged[i].body = bodies[i];
    tagged[i].instance = tagged[i].node = tagged[i].mesh = i;
    tagged[i].material = i % 3 == 2 ? 1 : 0;
    tagged[i].node_name = i % 5 == 0 ? "leg" : "arm";
    tagged[i].mesh_name = "body";
  }
  std::vector<Material> materials(2);
  materials[1].base_color_factor = {0.25f, 0.5f, 0.75f, 1};
  return testing::WriteMesh(tagged, materials);
}

TriangleMesh NestedBoxes() {
  std::vector<testing::Body> boxes;
  for (int i = 0; i < 40; ++i) {
    const double in = 0.45 * (i % 2 == 0 ? i : 39 - i);
    boxes.push_back(testing::Box({in, in + 0.1, in}, {39 - in, 38 - in, 39.5 - in}));
    if (i % 7 == 3) boxes.back() = testing::InsideOut(std::move(boxes.back()));
  }
  return Bodies(boxes);
}

// Thin plates across the rows: each row has two crossings a plate.
TriangleMesh Plates(int plates) {
  std::vector<testing::Body> boxes;
  for (int i = 0; i < plates; ++i) {
    const double x = 40.0 * ((i * 7) % plates) / plates;
    boxes.push_back(testing::Box({x, 0.2, -1}, {x + (i % 4 == 0 ? 5 : 0.6), 5.7, 6.2}));
  }
  return Bodies(boxes);
}

// Open parts of triangles anywhere: each triangle a run.
TriangleMesh Scattered(uint32_t seed, int triangles) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(0, 40), side(-1.5, 1.5);
  std::vector<testing::Body> bodies(static_cast<size_t>(triangles));
  for (testing::Body& body : bodies) {
    const Vec3d at{place(random), place(random), place(random)};
    for (int i = 0; i < 3; ++i) body.positions.push_back(at + Vec3d{side(random), side(random), side(random)});
    body.triangles.push_back({0, 1, 2});
  }
  return Bodies(bodies);
}

}  // namespace

std::vector<ParityMesh> PartMeshes(uint32_t seed, bool quick) {
  std::vector<ParityMesh> meshes;
  const auto assembly = [&](const char* name, AssemblyKind kind) {
    kind.seed = seed + uint32_t(meshes.size());
    kind.extent = 38;
    meshes.push_back({name, 40, [kind] { return testing::RandomAssembly(kind).mesh; }});
  };
  assembly("parts_masked", {.bodies = 9, .masks = true});
  assembly("parts_placed", {.bodies = 12, .placed = true, .moves = true, .colors = true});
  meshes.push_back({"parts_rows", 40, [] { return Plates(300); }});
  if (quick) return meshes;
  assembly("parts_open", {.bodies = 40, .open = true, .colors = true});
  assembly("parts_all", {.bodies = 25, .placed = true, .open = true, .moves = true, .colors = true, .masks = true});
  meshes.push_back({"parts_long_rows", 40, [] { return Plates(3000); }});
  meshes.push_back({"parts_nested", 40, NestedBoxes});
  meshes.push_back({"parts_scattered", 40, [seed] { return Scattered(seed, 6000); }});
  meshes.push_back({"parts_many", 40, [seed] { return Scattered(seed, 60'000); }});
  return meshes;
}

std::vector<ParityCase> PartCases(const ParityMesh& named, bool quick) {
  const std::array grids = {Placed({39, 37, 35}, {0, 0, 0}, {1, 1, 1}), GridsFor(named.extent)[12],
                            Placed({70, 41, 38}, {-1, -2, -0.5}, {0.61, 1.125, 1.2}),
                            Placed({1100, 9, 11}, {-0.5, 1, 2}, {0.037, 2.5, 1})};
  std::vector<ParityCase> cases;
  size_t turn = 0;
  for (const std::vector<TargetSpec>& targets : TargetSets()) {
    for (const PartScope scope : {PartScope::kNode, PartScope::kFile, PartScope::kMaterial, PartScope::kMesh}) {
      for (const ResultKind result : {ResultKind::kDense, ResultKind::kSparse}) {
        ++turn;
        if (quick && (turn + named.name.size()) % 4 != 0) continue;
        ParityCase c;
        VoxelizeRequest& r = c.request;
        r.grid = grids[quick ? turn / 4 % 3 : turn % grids.size()];
        r.targets = targets;
        r.result = result;
        r.parts.scope = scope;
        if (turn % 3 != 0) r.parts.priorities = {{"leg*", 2}, {"", -1}};
        if (turn % 5 == 0) r.parts.labels = {{"a*", 77}};
        r.fill = turn / 2 % 2 == 0 ? Fill::kParity : Fill::kNonzero;
        r.coverage =
            std::array{Coverage::kConservative, Coverage::kThin, Coverage::kNone, Coverage::kCenter}[turn / 3 % 4];
        r.layout = turn % 5 < 2 ? Layout::kPlanar : Layout::kInterleaved;
        if (turn % 3 == 1) c.slab_depth = 8;
        c.streamed = turn % 7 == 0;
        cases.push_back(c);
      }
    }
  }
  return cases;
}

}  // namespace voxelpipe::gpu
