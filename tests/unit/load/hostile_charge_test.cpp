// What files of a few bytes make the program allocate is charged to the job's memory, and refused where that has not so
// much.
#include <iostream>
#include <string>
#include <vector>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "load/load_job.h"
#include "mesh/flatten_job.h"
#include "mesh/report.h"
#include "mesh/scene/pose.h"
#include "pipeline/voxelize.h"
#include "support/counting_memory.h"
#include "support/meshes/hostile_meshes.h"
#include "support/meshes/zip_maker.h"

namespace voxelpipe {
namespace {

using namespace testing;

// File to flat mesh with all of its textures, posed if there is something to pose.
absl::Status LoadAll(const JobContext& job, const ByteVector& file) {
  absl::StatusOr<Scene> scene = LoadSceneFor(job, file);
  if (!scene.ok()) return scene.status();
  absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, {});
  if (!mesh.ok()) return mesh.status();
  *scene = Scene();
  if (absl::Status s = PrepareTexturesFor(job, *mesh, {}, {true, true, true}); !s.ok()) return s;
  if (const auto report = ReportMesh(job, *mesh); !report.ok()) return report.status();
  if (mesh->rig == nullptr) return absl::OkStatus();
  return EvaluatePoseFor(job, *mesh->rig, {}).status();
}

// With much memory it takes what it charges, but for what all files take; with less than that it is refused.
void ExpectCharged(const ByteVector& file, uint64_t least_bytes) {
  constexpr uint64_t kOfAllFiles = 4 * kMiB;
  MemoryBudget memory(uint64_t{4} << 30);
  JobContext job;
  job.set_memory(&memory);
  const uint64_t before = AllocatedBytes();
  ResetAllocatedPeak();
  const absl::Status status = LoadAll(job, file);
  const uint64_t measured = CountsMemory() ? AllocatedPeak() - before : 0;
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(memory.used_bytes(), 0u);
  EXPECT_LE(measured, memory.peak_bytes() + memory.peak_bytes() / 4 + kOfAllFiles);
  EXPECT_GE(memory.peak_bytes(), least_bytes);
  std::cout << file.size() << " bytes: charged " << (memory.peak_bytes() >> 10) << " KiB, measured " << (measured >> 10)
            << " KiB" << std::endl;

  MemoryBudget little(memory.peak_bytes() / 2);
  job.set_memory(&little);
  const absl::Status refused = LoadAll(job, file);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted) << refused;
  EXPECT_TRUE(LimitErrorOf(refused).has_value()) << refused;
}

// `head`, then `part` so often, then `tail`.
std::string Repeated(const std::string& head, const std::string& part, size_t count, const std::string& tail = "") {
  std::string text = head;
  text.reserve(head.size() + count * part.size() + tail.size());
  for (size_t i = 0; i < count; ++i) text += part;
  return text + tail;
}

// Stored: what is deflated may not be much larger.
std::string Package(const std::string& resources) {
  ZipMaker zip;
  zip.Add("3D/3dmodel.model", Model3mf(resources, "<item objectid=\"1\"/>"), false);
  return zip.Bytes();
}

// Lists that grow to twice their size hold the old one and the new one while their elements move.
TEST(HostileChargeTest, ListsThatGrowAreRefusedBeforeTheyDo) {
  constexpr size_t kCount = 300'000;  // soon after the lists grew to 512 Ki
  const std::string object = "<object id=\"1\">", vertices = "<mesh><vertices>";
  const std::string vertex = "<vertex x=\"0\" y=\"0\" z=\"0\"/>", one = Repeated(object + vertices, vertex, 3);
  const std::string mesh =
      one + "</vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object>";
  const std::pair<const char*, std::string> kFiles[] = {
      {"vertices of OBJ", Repeated("", "v 0 0 0\n", kCount)},
      {"all lists of OBJ", Repeated("", "v 0 0 0 1 1 1\nvt 0 0\nvn 0 0 1\n", kCount)},
      {"corners of OBJ", Repeated("v 0 0 0\nf", " 1", kCount)},
      {"triangles of OBJ", Repeated("v 0 0 0\n", "f 1 1 1\n", kCount)},
      {"primitives of OBJ", Repeated("v 0 0 0\n", "usemtl a\nf 1 1 1\nusemtl b\nf 1 1 1\n", kCount / 40)},
      {"facets of STL", Repeated("solid\n",
                                 "facet normal 0 0 0 outer loop vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 "
                                 "endloop endfacet\n",
                                 kCount / 2)},
      {"corners of PLY", Repeated("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                                  "property float z\nelement face 1\nproperty list int int vertex_indices\nend_header\n"
                                  "0 0 0\n" +
                                      std::to_string(kCount),
                                  " 0", kCount)},
      {"triangles of OFF", Repeated("OFF\n1 " + std::to_string(kCount) + " 0\n0 0 0\n", "3 0 0 0\n", kCount)},
      {"vertices of 3MF",
       Package(Repeated(object + vertices, vertex, kCount, "</vertices><triangles></triangles></mesh></object>"))},
      {"triangles of 3MF", Package(Repeated(one + "</vertices><triangles>", "<triangle v1=\"0\" v2=\"1\" v3=\"2\"/>",
                                            kCount, "</triangles></mesh></object>"))},
      {"components of 3MF", Package(Repeated(object + "<components>", "<component objectid=\"2\"/>", kCount / 4,
                                             "</components></object><object id=\"2\">" + mesh.substr(object.size())))}};
  for (const auto& [name, file] : kFiles) {
    SCOPED_TRACE(name);
    std::cout << name << ": ";
    ExpectCharged(ByteVector(file.begin(), file.end()), 0);
    // Whatever the limit is, no more than that is taken.
    for (const uint64_t limit : {6 * kMiB, 14 * kMiB, 30 * kMiB}) {
      MemoryBudget memory(limit);
      JobContext job;
      job.set_memory(&memory);
      const ByteVector bytes(file.begin(), file.end());
      const uint64_t before = AllocatedBytes();
      ResetAllocatedPeak();
      const absl::Status status = LoadAll(job, bytes);
      const uint64_t measured = CountsMemory() ? AllocatedPeak() - before : 0;
      EXPECT_LE(measured, limit + limit / 8 + kMiB) << limit << ": " << status;
    }
  }
}

TEST(HostileChargeTest, NumbersOfJson) {
  const std::string file =
      Repeated(R"({"asset":{"version":"2.0"},"meshes":[{"primitives":[],"weights":[0)", ",0", 300'000, "]}]}");
  ExpectCharged(ByteVector(file.begin(), file.end()), 300'000 * sizeof(double));
}

TEST(HostileChargeTest, Primitives) {
  ExpectCharged(PrimitivesWithoutData(20'000, 0), 20'000 * sizeof(Primitive));
}

TEST(HostileChargeTest, PrimitivesForWeightsOfNodes) {
  ExpectCharged(PrimitivesWithoutData(1000, 100), 100 * 1000 * sizeof(Primitive));
}

TEST(HostileChargeTest, WeightsOfNodesInTheRig) {
  ExpectCharged(WeightsOfManyNodes(10'000, 500), 2 * 500 * 10'000 * sizeof(double));
}

TEST(HostileChargeTest, Animations) {
  ExpectCharged(EmptyObjects(kMiB / 2, "animations"), 100'000 * sizeof(Animation));
}

TEST(HostileChargeTest, MorphTargets) {
  ExpectCharged(TargetsWithoutData(100'000, 1), 100'000 * sizeof(MorphTarget));
}

TEST(HostileChargeTest, ValuesOfExtensions) {
  ExpectCharged(NumbersOfMaterials(100, 10'000, "a"), 0);
  ExpectCharged(NumbersOfMaterials(100, 10'000, "diffuseFactor"), 0);
  ExpectCharged(NumbersOfMaterials(20'000, 4, "diffuseFactor"), 20'000 * 4 * 152);
}

TEST(HostileChargeTest, TransformsOfJoints) {
  ExpectCharged(JointsWithoutData(100, 2000), 100 * 2000 * 2 * sizeof(Mat4d));
}

TEST(HostileChargeTest, TextsOfImages) {
  // They are passed over, not charged.
  MemoryBudget memory(64 * kMiB);
  JobContext job;
  job.set_memory(&memory);
  const ByteVector file = PngWithTexts(16);
  const uint64_t before = AllocatedBytes();
  ResetAllocatedPeak();
  const absl::Status status = LoadAll(job, file);
  EXPECT_TRUE(status.ok()) << status;
  if (CountsMemory()) {
    EXPECT_LT(AllocatedPeak() - before, 8 * kMiB);
  }
}

TEST(HostileChargeTest, EdgesOfAReport) {
  const Shape torus = TorusShape(300, 300);
  ExpectCharged(MakeGlb(torus.positions, torus.indices), torus.indices.size() * sizeof(uint64_t));
}

TEST(HostileChargeTest, PosedPartsAreRefusedBeforeTheyAreMade) {
  const auto voxelize = [](int targets, uint64_t instances, MemoryBudget& memory) -> absl::Status {
    JobContext job;
    job.set_memory(&memory);
    const absl::StatusOr<Scene> scene = LoadSceneFor(job, TargetsWithoutData(targets, instances));
    if (!scene.ok()) return scene.status();
    const absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, {});
    if (!mesh.ok()) return mesh.status();
    VoxelizeRequest request;
    request.backend = BackendChoice::kCpu;
    request.vertex_shader = {"morph", {{"weights", {1}}}};
    ResetAllocatedPeak();
    return Voxelize(*mesh, request, {job}).status();
  };
  MemoryBudget memory(64 * kMiB);
  const uint64_t before = AllocatedBytes();
  const absl::Status status = voxelize(1000, 10'000, memory);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_TRUE(LimitErrorOf(status).has_value()) << status;
  if (CountsMemory()) {
    EXPECT_LT(AllocatedPeak() - before, 80 * kMiB);
  }
  EXPECT_EQ(memory.used_bytes(), 0u);
  const absl::Status small = voxelize(4, 10, memory);
  EXPECT_TRUE(small.ok()) << small;
}

// Everything that is wrong with parts of a scene.
std::vector<std::string> FaultsOf(const Scene& scene) {
  std::vector<std::string> faults;
  for (const Animation& animation : scene.animations) faults.push_back(animation.fault.ToString());
  for (const Mesh& mesh : scene.meshes) {
    for (const Primitive& primitive : mesh.primitives) {
      if (primitive.morph == nullptr) continue;
      for (const MorphTarget& target : primitive.morph->targets) faults.push_back(target.fault.ToString());
    }
  }
  for (const auto& image : scene.images) faults.push_back(image->fault ? image->fault->text : "");
  return faults;
}

TEST(HostileChargeTest, WhatOthersUseNowIsNoFaultOfTheFile) {
  constexpr size_t kKeys = 20'000;
  GlbBuilder builder;
  nlohmann::json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["attributes"]["POSITION"] = builder.Vectors(std::vector<float>(3 * kKeys, 0.5f), "VEC3");
  primitive["targets"] = {{{"POSITION", builder.Vectors(std::vector<float>(3 * kKeys, 1.0f), "VEC3")}}};
  builder.Mesh(primitive);
  const int node = builder.Node({{"mesh", 0}});
  builder.Scene({node});
  std::vector<float> times;
  for (size_t i = 0; i < kKeys; ++i) times.push_back(float(i));
  const int input = builder.Vectors(times, "SCALAR");
  const int output = builder.Vectors(std::vector<float>(3 * kKeys, 2.0f), "VEC3");
  builder.doc["animations"] = {{{"samplers", {{{"input", input}, {"output", output}}}},
                                {"channels", {{{"sampler", 0}, {"target", {{"node", node}, {"path", "scale"}}}}}}}};
  const int view = builder.View(ByteVector(64, 1));
  builder.doc["bufferViews"][size_t(view)]["byteLength"] = 64;
  builder.doc["bufferViews"][size_t(view)]["extensions"]["EXT_meshopt_compression"] = {
      {"buffer", 0}, {"byteLength", 64}, {"byteStride", 16}, {"count", kKeys}, {"mode", "ATTRIBUTES"}};
  builder.doc["images"] = {{{"bufferView", view}, {"mimeType", "image/png"}}};  // no stream: a fault of the file
  const ByteVector file = builder.Glb();

  const auto load = [&](uint64_t limit_bytes) {
    MemoryBudget all(limit_bytes);
    MemoryBudget others(kMiB, &all), own(uint64_t{1} << 30, &all);
    MemoryCharge charge(&others);
    EXPECT_TRUE(charge.Grow(1, "others").ok());
    JobContext job;
    job.set_memory(&own);
    absl::StatusOr<Scene> scene = LoadSceneFor(job, file);
    absl::StatusOr<std::vector<std::string>> faults =
        scene.ok() ? absl::StatusOr<std::vector<std::string>>(FaultsOf(*scene)) : scene.status();
    scene = absl::CancelledError();  // before the budget goes
    return faults;
  };
  const auto right = load(uint64_t{1} << 30);
  ASSERT_TRUE(right.ok()) << right.status();
  ASSERT_EQ(right->size(), 3u);
  EXPECT_EQ((*right)[0], "OK");
  EXPECT_EQ((*right)[1], "OK");
  int refused = 0, loaded = 0;
  for (uint64_t limit = 64 << 10; limit < 4 * kMiB; limit += 32 << 10) {
    const auto faults = load(limit);
    if (faults.ok()) {
      EXPECT_EQ(*faults, *right) << limit;
      ++loaded;
    } else {
      EXPECT_TRUE(IsInUseByOthers(faults.status())) << limit << ": " << faults.status();
      ++refused;
    }
  }
  EXPECT_GT(refused, 10);
  EXPECT_GT(loaded, 10);
}

}  // namespace
}  // namespace voxelpipe
