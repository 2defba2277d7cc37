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
