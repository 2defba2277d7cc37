// The parts of a mesh: how they are cut, named and numbered, and left out.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "mesh/parts/part_list.h"
#include "mesh/placed_mesh.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::Cube;
using ::testing::ElementsAre;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::RunError;
using testing::RunPipeline;
using testing::ValueAt;

TriangleMesh Flat(const GlbBuilder& glb) {
  const auto scene = LoadScene(glb.Glb());
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  auto mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
}

PartSelection Scope(PartScope scope) {
  PartSelection selection;
  selection.scope = scope;
  return selection;
}

PartSelection Excluding(PartScope scope, std::vector<std::string> patterns) {
  PartSelection selection = Scope(scope);
  selection.exclude = std::move(patterns);
  return selection;
}

PartList List(const TriangleMesh&& mesh, const PartSelection& selection) = delete;  // names refer to the mesh
PartList List(const TriangleMesh& mesh, const PartSelection& selection) {
  absl::StatusOr<PartList> list = ListParts(JobContext(), mesh, selection);
  EXPECT_TRUE(list.ok()) << list.status();
  return list.ok() ? *std::move(list) : PartList{};
}

TriangleMesh Exclude(const TriangleMesh& mesh, const PartSelection& selection) {
  absl::StatusOr<TriangleMesh> kept = ExcludeParts(JobContext(), mesh, selection);
  EXPECT_TRUE(kept.ok()) << kept.status();
  return kept.ok() ? *std::move(kept) : TriangleMesh{};
}

std::string ListError(const TriangleMesh& mesh, const PartSelection& selection) {
  const absl::Status status = ListParts(JobContext(), mesh, selection).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  return std::string(status.message());
}

std::vector<std::string> Names(const PartList& list) {
  std::vector<std::string> names;
  for (const Part& part : list.parts) names.emplace_back(part.name);
  return names;
}

std::vector<uint32_t> Labels(const PartList& list) {
  std::vector<uint32_t> labels;
  for (const Part& part : list.parts) labels.push_back(part.label);
  return labels;
}

std::vector<std::string> Texts(const WarningList& warnings) {
  std::vector<std::string> texts;
  for (const Warning& warning : warnings.kept()) texts.push_back(warning.text);
  return texts;
}

nlohmann::json Triangle(GlbBuilder& glb, float x, int material = -1) {
  nlohmann::json primitive = glb.Primitive({{x, 0, 0}, {x + 1, 0, 0}, {x, 1, 0}});
  if (material >= 0) primitive["material"] = material;
  return primitive;
}

// Two meshes, of which "wheel" has two materials and is drawn twice, by the node "left" and by a child of it without a
// name. "body" has no material.
GlbBuilder Car() {
  GlbBuilder glb;
  glb.doc["materials"] = nlohmann::json::array({{{"name", "rubber"}}, {{"name", "steel"}}});
  const int body = glb.Mesh(Triangle(glb, 0)), wheel = glb.Mesh(Triangle(glb, 2, 1));
  glb.doc["meshes"][body]["name"] = "body";
  glb.doc["meshes"][wheel]["name"] = "wheel";
  glb.doc["meshes"][wheel]["primitives"].push_back(Triangle(glb, 4, 0));
  const int child = glb.Node({{"mesh", wheel}});
  const int unnamed = glb.Node({{"children", {child}}});
  const int left = glb.Node({{"mesh", wheel}, {"name", "left"}, {"children", {unnamed}}});
  glb.Scene({glb.Node({{"mesh", body}}), left});
  return glb;
}

TEST(PartListTest, PatternsMatchTheWholeName) {
  EXPECT_TRUE(MatchesPattern("", ""));
  EXPECT_FALSE(MatchesPattern("", "a"));
  EXPECT_FALSE(MatchesPattern("?", ""));
  EXPECT_TRUE(MatchesPattern("*", ""));
  EXPECT_TRUE(MatchesPattern("**", "any thing"));
  EXPECT_TRUE(MatchesPattern("wheel*", "wheel"));
  EXPECT_FALSE(MatchesPattern("wheel", "wheel.001"));
  EXPECT_FALSE(MatchesPattern("Wheel*", "wheel")) << "case matters";
  EXPECT_TRUE(MatchesPattern("*l*l", "wheel.l")) << "the first * takes more than its first chance";
  EXPECT_TRUE(MatchesPattern("a*b?d", "a-bcbxd"));
  EXPECT_FALSE(MatchesPattern("a*b?d", "a-bcbd-"));
  EXPECT_TRUE(MatchesPattern("[a]\\*", "[a]\\b")) << "all else is itself";
}

TEST(PartListTest, AQuestionMarkIsOneCharacterOfUtf8) {
  EXPECT_TRUE(MatchesPattern("R?der",
                             "R\xC3\xA4"
                             "der"));
  EXPECT_TRUE(MatchesPattern("?", "\xE8\xBD\xAE"));
  EXPECT_TRUE(MatchesPattern("??", "\xE8\xBD\xAE\xF0\x9F\x9B\x9E"));
  EXPECT_FALSE(MatchesPattern("?", "\xE8\xBD\xAE\xE8\xBD\xAE"));
  EXPECT_FALSE(MatchesPattern("??", "\xC3\xA4"));
  EXPECT_TRUE(MatchesPattern("*?", "\xC3\xA4\xC3\xB6"));
  EXPECT_TRUE(MatchesPattern("??", "\xFF\xFE")) << "bytes that begin nothing are characters";
}

TEST(PartListTest, TheWholeIsOnePart) {
  const TriangleMesh car = Flat(Car());
  const PartList list = List(car, {});
  ASSERT_EQ(list.parts.size(), 1u);
  EXPECT_EQ(list.parts[0].name, "");
  EXPECT_EQ(list.parts[0].label, 1u);
  EXPECT_EQ(list.parts[0].triangle_count, 5u);
}

TEST(PartListTest, NodesAreNamedByThemselvesOrTheNearestNamedAncestor) {
  const TriangleMesh car = Flat(Car());
  const PartList list = List(car, Scope(PartScope::kNode));
  EXPECT_THAT(Names(list), ElementsAre("", "left", "left"));
  EXPECT_THAT(Labels(list), ElementsAre(1, 2, 3));
  EXPECT_THAT(list.of_run, ElementsAre(0, 1, 1, 2, 2));
  EXPECT_EQ(list.parts[2].first_triangle, 3u);
  EXPECT_EQ(list.parts[2].triangle_count, 2u);
}

TEST(PartListTest, InstancesOfAMeshAreOnePart) {
  const TriangleMesh car = Flat(Car());
  const PartList list = List(car, Scope(PartScope::kMesh));
  EXPECT_THAT(Names(list), ElementsAre("body", "wheel"));
  EXPECT_EQ(list.parts[1].triangle_count, 4u);
}

TEST(PartListTest, WhatHasNoMaterialIsAPartWithoutAName) {
  const TriangleMesh car = Flat(Car());
  const PartList list = List(car, Scope(PartScope::kMaterial));
  EXPECT_THAT(Names(list), ElementsAre("", "steel", "rubber")) << "by their first triangle";
  EXPECT_THAT(list.of_run, ElementsAre(0, 1, 2, 1, 2));
}

TEST(PartListTest, EachInstanceOfGpuInstancingIsAPart) {
  GlbBuilder glb;
  const int one = glb.Mesh(Triangle(glb, 0)), two = glb.Mesh(Triangle(glb, 0));
  glb.doc["meshes"][two]["primitives"].push_back(Triangle(glb, 1));
  const int places = glb.Vectors({0, 0, 0, 5, 0, 0, 9, 0, 0}, "VEC3");
  nlohmann::json many;
  many["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", places}};
  glb.doc["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
  glb.Scene({glb.Node({{"mesh", one}, {"name", "tree"}, {"extensions", many}}),
             glb.Node({{"mesh", two}, {"name", "bush"}, {"extensions", many}})});
  const TriangleMesh mesh = Flat(glb);
  const PartList list = List(mesh, Scope(PartScope::kNode));
  EXPECT_THAT(Names(list), ElementsAre("tree", "tree", "tree", "bush", "bush", "bush"));
  EXPECT_THAT(list.of_run, ElementsAre(0, 1, 2, 3, 3, 4, 4, 5, 5));
}

TEST(PartListTest, TheLastRuleThatMatchesGivesTheNumber) {
  const TriangleMesh car = Flat(Car());
  PartSelection selection = Scope(PartScope::kNode);
  selection.labels = {{"*", 7}, {"left", 9}, {"le*", 8}};
  selection.priorities = {{"left", 3}, {"", -4}};
  const PartList list = List(car, selection);
  EXPECT_THAT(Labels(list), ElementsAre(7, 8, 8));
  EXPECT_EQ(list.parts[0].priority, -4);
  EXPECT_EQ(list.parts[1].priority, 3);
  EXPECT_EQ(list.parts[0].rank, 0u);
  EXPECT_EQ(list.parts[1].rank, 1u);
  EXPECT_EQ(list.parts[2].rank, 2u) << "equal priorities: by number";
  EXPECT_THAT(list.warnings.kept(), IsEmpty());
  selection.priorities = {{"left", -1}};
  EXPECT_EQ(List(car, selection).parts[0].rank, 2u);
}

TEST(PartListTest, PatternsWithoutAPartAreWarnings) {
  const TriangleMesh car = Flat(Car());
  PartSelection selection = Scope(PartScope::kMesh);
  selection.labels = {{"engine", 2}, {"wheel", 3}};
  selection.priorities = {{"b?dies", 2}};
  const PartList list = List(car, selection);
  EXPECT_THAT(Texts(list.warnings), ElementsAre("no part is called 'engine'; there are 'body', 'wheel'",
                                                "no part is called 'b?dies'; there are 'body', 'wheel'"));
  EXPECT_EQ(list.warnings.kept()[0].code, WarningCode::kPartNotFound);
}

std::shared_ptr<const TriangleMesh> SharedCar() {
  return std::make_shared<const TriangleMesh>(Flat(Car()));
}

TriangleMesh Place(const std::vector<PlacedMesh>& meshes) {
  absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(JobContext(), meshes);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
}

PlacedMesh Entry(std::shared_ptr<const TriangleMesh> mesh, const std::string& name) {
  PlacedMesh placed;
  placed.mesh = std::move(mesh);
  placed.name = name;
  return placed;
}

TEST(PartListTest, PlacedMeshesAreFilesWithLabelsAndPriorities) {
  const auto car = SharedCar();
  std::vector<PlacedMesh> meshes = {Entry(car, "red"), Entry(std::make_shared<const TriangleMesh>(), "empty"),
                                    Entry(car, "blue")};
  meshes[2].priority = 5;
  meshes[0].label = 40;
  const TriangleMesh placed = Place(meshes);
  const PartList files = List(placed, Scope(PartScope::kFile));
  EXPECT_THAT(Names(files), ElementsAre("red", "blue"));
  EXPECT_THAT(Labels(files), ElementsAre(40, 3)) << "its number in the list, not among parts";
  EXPECT_EQ(files.parts[1].priority, 5);
  EXPECT_EQ(files.parts[1].placed, 2u);
  const PartList nodes = List(placed, Scope(PartScope::kNode));
  EXPECT_THAT(Names(nodes), ElementsAre("", "left", "left", "", "left", "left"));
  EXPECT_THAT(Labels(nodes), ElementsAre(1, 2, 3, 4, 5, 6)) << "those of placed meshes are for files";
  EXPECT_EQ(nodes.parts[3].priority, 5);
  EXPECT_THAT(Names(List(placed, Scope(PartScope::kMesh))), ElementsAre("body", "wheel", "body", "wheel"));
  EXPECT_THAT(Names(List(placed, Scope(PartScope::kMaterial))), ElementsAre("", "steel", "rubber", "steel", "rubber"))
      << "no material is one part, of the first of its triangles";
}

TEST(PartListTest, OneMeshAloneIsAFile) {
  const TriangleMesh car = Flat(Car());
  EXPECT_THAT(Names(List(car, Scope(PartScope::kFile))), ElementsAre(""));
}

TEST(PartListTest, RulesOutOfRangeAreNamed) {
  const TriangleMesh car = Flat(Car());
  PartSelection selection = Scope(PartScope::kNode);
  selection.labels = {{"a", 0}};
  EXPECT_EQ(ListError(car, selection), "parts: the label 0 of 'a' must be from 1 to 4294967295");
  selection.labels = {{"a", int64_t{1} << 32}};
  EXPECT_THAT(ListError(car, selection), HasSubstr("label 4294967296"));
  selection.labels = {{"a", UINT32_MAX}};
  selection.priorities = {{"b", INT32_MAX}, {"b", int64_t{INT32_MIN} - 1}};
  EXPECT_THAT(ListError(car, selection), HasSubstr("the priority -2147483649 of 'b'"));
  selection.priorities.assign(kMaxPartRules + 1, {"b", 1});
  EXPECT_THAT(ListError(car, selection), HasSubstr("1001 rules for priority; at most 1000"));
  EXPECT_THAT(ListError(car, Excluding(PartScope::kNode, std::vector<std::string>(1001, "a"))), HasSubstr("at most"));
  selection = Scope(PartScope::kWhole);
  selection.labels = {{"a", 1}};
  EXPECT_THAT(ListError(car, selection), HasSubstr("need parts: file, node, mesh or material"));
}

// A mesh of so many single triangles, each of a node of its own.
TriangleMesh ManyNodes(size_t count) {
  TriangleMesh mesh;
  mesh.positions.resize(3 * count);
  for (size_t t = 0; t < count; ++t) {
    mesh.positions[3 * t] = {double(t % 64), double(t / 64 % 64), double(t / 4096)};
    mesh.positions[3 * t + 1] = mesh.positions[3 * t + 2] = mesh.positions[3 * t];
    const auto v = uint32_t(3 * t);
    mesh.triangles.push_back({v, v + 1, v + 2});
    MeshPart part;
    part.first_triangle = t;
    part.triangle_count = 1;
    part.first_vertex = 3 * t;
    part.vertex_count = 3;
    part.node = uint32_t(t);
    mesh.parts.push_back(part);
  }
  return mesh;
}

TEST(PartListTest, MorePartsThanALabelOf16BitsAreRefused) {
  const TriangleMesh mesh = ManyNodes(kMaxParts);
  const PartList most = List(mesh, Scope(PartScope::kNode));
  ASSERT_EQ(most.parts.size(), kMaxParts);
  EXPECT_EQ(most.parts.back().label, kMaxParts);
  EXPECT_EQ(ListError(ManyNodes(70'000), Scope(PartScope::kNode)),
            "parts: the mesh has 70000 parts; at most 65535 are allowed");
  // Parts that are left out do not count.
  EXPECT_TRUE(Exclude(ManyNodes(70'000), Excluding(PartScope::kNode, {"?"})).parts_left_out);
}

TEST(PartListTest, ListsAreCharged) {
  MemoryBudget budget(1 << 20);
  JobContext job;
  job.set_memory(&budget);
  const TriangleMesh many = ManyNodes(60'000);
  EXPECT_EQ(ListParts(job, many, Scope(PartScope::kNode)).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ExcludeParts(job, many, Excluding(PartScope::kNode, {"a"})).status().code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(budget.used_bytes(), 0u);
}

// Backtracking of a name and a pattern of a megabyte each would take hours.
TEST(PartListTest, LongPatternsEndWithTheJob) {
  GlbBuilder glb = Car();
  glb.doc["meshes"][0]["name"] = std::string(1 << 20, 'a');
  const TriangleMesh mesh = Flat(glb);
  const std::string pattern = "*" + std::string(1 << 19, 'a') + "b";
  PartSelection selection = Scope(PartScope::kMesh);
  selection.labels = {{pattern, 1}};
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(50));
  EXPECT_EQ(ListParts(job, mesh, selection).status().code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(ExcludeParts(job, mesh, Excluding(PartScope::kMesh, {pattern})).status().code(),
            absl::StatusCode::kDeadlineExceeded);
}

// Three meshes of which the middle one alone has _HEAT, and the outer ones have _COLD; the last has a vertex that no
// triangle uses.
TriangleMesh Attributed() {
  GlbBuilder glb;
  const auto with = [&](float x, const char* name, const std::vector<float>& values) {
    nlohmann::json primitive = Triangle(glb, x);
    primitive["attributes"][name] = glb.Vectors(values, "SCALAR");
    return glb.Mesh(primitive);
  };
  const int a = with(0, "_COLD", {1, 2, 3}), b = with(2, "_HEAT", {4, 5, 6});
  nlohmann::json last = glb.Primitive({{9, 9, 9}, {4, 0, 0}, {5, 0, 0}, {4, 1, 0}}, {1, 2, 3});
  last["attributes"]["_COLD"] = glb.Vectors({6, 7, 8, 9}, "SCALAR");
  last["attributes"]["NORMAL"] = glb.Vectors({0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1}, "VEC3");
  const int c = glb.Mesh(last);
  glb.Scene({glb.Node({{"mesh", a}, {"name", "a"}}), glb.Node({{"mesh", b}, {"name", "b"}}),
             glb.Node({{"mesh", c}, {"name", "c"}})});
  return Flat(glb);
}

TEST(ExcludePartsTest, ArraysHoldWhatIsLeft) {
  const TriangleMesh all = Attributed();
  const TriangleMesh kept = Exclude(all, Excluding(PartScope::kNode, {"b"}));
  EXPECT_TRUE(kept.parts_left_out);
  EXPECT_EQ(kept.content_id, "");
  ASSERT_EQ(kept.positions.size(), 7u);
  EXPECT_EQ(kept.positions[2], all.positions[2]);
  EXPECT_EQ(kept.positions[4], all.positions[7]);
  EXPECT_EQ(kept.normals[5], all.normals[8]);
  EXPECT_THAT(kept.triangles, ElementsAre(std::array<uint32_t, 3>{0, 1, 2}, std::array<uint32_t, 3>{4, 5, 6}));
  ASSERT_TRUE(kept.unused_vertices);
  EXPECT_THAT(*kept.unused_vertices, ElementsAre(3));
  ASSERT_EQ(kept.parts.size(), 2u);
  EXPECT_EQ(kept.parts[1].first_vertex, 3u);
  EXPECT_EQ(kept.parts[1].first_triangle, 1u);
  EXPECT_EQ(kept.parts[1].node, 2u) << "ids of the file stay";
  EXPECT_EQ(kept.mesh_count, 3u);
  EXPECT_THAT(Names(List(kept, Excluding(PartScope::kNode, {"b"}))), ElementsAre("a", "c"));
}

TEST(ExcludePartsTest, AttributesKeepTheirVertices) {
  const TriangleMesh all = Attributed();
  ASSERT_EQ(all.attributes.size(), 2u);
  const TriangleMesh outer = Exclude(all, Excluding(PartScope::kNode, {"b"}));
  EXPECT_EQ(outer.attributes[0].name, "_COLD");
  EXPECT_TRUE(outer.attributes[0].runs.empty()) << "all have it";
  EXPECT_THAT(outer.attributes[0].values, ElementsAre(1, 2, 3, 6, 7, 8, 9));
  EXPECT_THAT(outer.attributes[1].values, IsEmpty());
  ASSERT_EQ(outer.attributes[1].runs.size(), 1u) << "no vertex has it";
  EXPECT_EQ(outer.attributes[1].runs[0].end_vertex, 0u);
  const TriangleMesh tail = Exclude(all, Excluding(PartScope::kNode, {"a"}));
  EXPECT_THAT(tail.attributes[0].values, ElementsAre(6, 7, 8, 9));
  ASSERT_EQ(tail.attributes[0].runs.size(), 1u);
  EXPECT_EQ(tail.attributes[0].runs[0].first_vertex, 3u);
  EXPECT_EQ(tail.attributes[0].runs[0].end_vertex, 7u);
  EXPECT_EQ(tail.attributes[0].runs[0].first_value, 0u);
  EXPECT_EQ(tail.attributes[1].runs[0].end_vertex, 3u);
  VoxelizeRequest request;
  request.grid.resolution = 9;
  request.targets = {testing::FloatTarget(1, Blend::kMax, {"attribute", {}, {{"name", "_HEAT"}}})};
  const VoxelizeResult result = RunPipeline(outer, request);
  const HostBuffer& heat = result.targets[0];
  for (uint64_t n = 0; n < heat.size() / sizeof(float); ++n) EXPECT_EQ(testing::FloatAt(heat, n), 0);
}

// What is left gives the bytes of a file that never had the rest.
TEST(ExcludePartsTest, TheRestIsAsInAFileOfItsOwn) {
  VoxelizeRequest request;
  request.grid.resolution = 30;
  request.parts = Excluding(PartScope::kNode, {"b", "c"});
  request.targets = {testing::TargetOf(VoxelFormat::kU16, 1, Blend::kMax, {"label", {}}),
                     testing::FloatTarget(1, Blend::kReplace, {"attribute", {}, {{"name", "_COLD"}}})};
  const VoxelizeResult one = RunPipeline(Exclude(Attributed(), request.parts), request);
  GlbBuilder glb;
  nlohmann::json primitive = Triangle(glb, 0);
  primitive["attributes"]["_COLD"] = glb.Vectors({1, 2, 3}, "SCALAR");
  glb.Scene({glb.Node({{"mesh", glb.Mesh(primitive)}})});
  request.parts = Scope(PartScope::kNode);
  const VoxelizeResult own = RunPipeline(Flat(glb), request);
  EXPECT_EQ(one.grid, own.grid);
  for (size_t t = 0; t < 2; ++t) EXPECT_EQ(testing::Bytes(one.targets[t]), testing::Bytes(own.targets[t]));
}

TEST(ExcludePartsTest, ARunWithAllPartsIsRefused) {
  VoxelizeRequest request;
  request.parts = Excluding(PartScope::kNode, {"b"});
  EXPECT_EQ(RunError(Attributed(), request).code(), absl::StatusCode::kInternal);
}

TEST(ExcludePartsTest, EntriesOfPlacedMeshesStayWithTheirParts) {
  const auto car = SharedCar();
  std::vector<PlacedMesh> meshes = {Entry(car, "red"), Entry(car, "green"), Entry(car, "blue")};
  const TriangleMesh kept = Exclude(Place(meshes), Excluding(PartScope::kFile, {"green"}));
  ASSERT_EQ(kept.placed.size(), 3u);
  EXPECT_EQ(kept.placed[1].first_part, 5u);
  EXPECT_EQ(kept.placed[2].first_part, 5u);
  const PartList files = List(kept, Excluding(PartScope::kFile, {"green"}));
  EXPECT_THAT(Names(files), ElementsAre("red", "blue"));
  EXPECT_THAT(Labels(files), ElementsAre(1, 3));
  EXPECT_THAT(Names(List(kept, Scope(PartScope::kNode))), ElementsAre("", "left", "left", "", "left", "left"));
  const TriangleMesh wheels = Exclude(Place(meshes), Excluding(PartScope::kMesh, {"body"}));
  EXPECT_THAT(Names(List(wheels, Scope(PartScope::kFile))), ElementsAre("red", "green", "blue"));
  EXPECT_EQ(wheels.placed[2].first_part, 8u);
}

// Two nodes that move: b from x = 2 to x = 12.
TEST(ExcludePartsTest, PosesAreThoseOfThePartsThatAreLeft) {
  GlbBuilder glb;
  const int still = glb.Node({{"mesh", glb.Mesh(Triangle(glb, 0))}, {"name", "a"}});
  const int moving = glb.Node({{"mesh", glb.Mesh(Triangle(glb, 2))}, {"name", "b"}});
  glb.Scene({still, moving});
  nlohmann::json animation;
  animation["samplers"] = {
      {{"input", glb.Vectors({0, 1}, "SCALAR")}, {"output", glb.Vectors({0, 0, 0, 10, 0, 0}, "VEC3")}}};
  animation["channels"] = {{{"sampler", 0}, {"target", {{"node", moving}, {"path", "translation"}}}}};
  glb.doc["animations"] = nlohmann::json::array({animation});
  const TriangleMesh kept = Exclude(Flat(glb), Excluding(PartScope::kNode, {"a"}));
  ASSERT_NE(kept.rig, nullptr);
  ASSERT_EQ(kept.rig->parts.size(), 1u);
  VoxelizeRequest request;
  request.grid.resolution = 8;
  request.vertex_shader = {"skin", {{"animation", {0}}, {"time", {1}}}};
  request.parts = Excluding(PartScope::kNode, {"a"});
  EXPECT_NEAR(RunPipeline(kept, request).grid.origin.x, 12, 1e-9);
}

TEST(ExcludePartsTest, NothingLeftIsAWarning) {
  const PartSelection selection = Excluding(PartScope::kMaterial, {"*"});
  const TriangleMesh kept = Exclude(Flat(Car()), selection);
  EXPECT_THAT(kept.triangles, IsEmpty());
  EXPECT_THAT(Texts(kept.warnings), ElementsAre("there is nothing to voxelize: every part is excluded"));
  VoxelizeRequest request;
  request.parts = selection;
  EXPECT_EQ(RunPipeline(kept, request).stats.occupied, 0u);
}

TEST(ExcludePartsTest, PatternsWithoutAPartAreWarnings) {
  const TriangleMesh kept = Exclude(Flat(Car()), Excluding(PartScope::kMesh, {"engine", "body"}));
  EXPECT_EQ(kept.triangles.size(), 4u);
  EXPECT_THAT(Texts(kept.warnings), ElementsAre("no part is called 'engine'; there are 'body', 'wheel'"));
  EXPECT_THAT(Exclude(ManyNodes(3), Excluding(PartScope::kMesh, {"engine"})).warnings.kept(), ::testing::SizeIs(1));
}

TEST(LabelShaderTest, AFormatThatDoesNotHoldTheLabelsIsRefused) {
  const TriangleMesh car = Flat(Car());
  VoxelizeRequest request;
  request.grid.resolution = 40;
  request.parts = Scope(PartScope::kNode);
  request.parts.labels = {{"left", 300}};
  request.targets = {testing::TargetOf(VoxelFormat::kU8, 1, Blend::kMax, {"label", {}})};
  EXPECT_EQ(RunError(car, request).message(),
            "targets[0].format: u8 does not hold the label 300 exactly; f16 holds all of them");
  request.targets[0].format = VoxelFormat::kU16;
  const VoxelizeResult result = RunPipeline(car, request);
  uint32_t most = 0;
  bool one = false;
  for (uint64_t n = 0; n < result.targets[0].size() / 2; ++n) {
    const uint32_t label = ValueAt<uint16_t>(result.targets[0], n);
    most = std::max(most, label);
    one = one || label == 1;
  }
  EXPECT_EQ(most, 300u);
  EXPECT_TRUE(one);
}

}  // namespace
}  // namespace voxelpipe
