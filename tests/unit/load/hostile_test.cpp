// The memory that a few bytes can need is charged to the job first, and loading stops soon after the job ends.
#include <algorithm>
#include <chrono>
#include <cstring>
#include <functional>
#include <iostream>
#include <string>
#include <string_view>
#include <thread>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "load/load_job.h"
#include "mesh/flatten_job.h"
#include "support/counting_memory.h"
#include "support/meshes/hostile_meshes.h"
#include "support/meshes/zip_maker.h"
#include "support/slowdown.h"

namespace voxelpipe {
namespace {

using namespace testing;
using std::chrono::milliseconds;

// File to flat mesh with all of its textures.
absl::Status LoadTextured(const JobContext& job, const ByteVector& file) {
  const absl::StatusOr<Scene> scene = LoadSceneFor(job, file);
  if (!scene.ok()) return scene.status();
  absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, {});
  if (!mesh.ok()) return mesh.status();
  return PrepareTexturesFor(job, *mesh, {}, {true, true, true});
}

struct Outcome {
  absl::Status status;
  uint64_t peak_bytes = 0;
};

Outcome LoadWithin(uint64_t limit_bytes, const ByteVector& file) {
  MemoryBudget memory(limit_bytes);
  JobContext job;
  job.set_memory(&memory);
  Outcome outcome{LoadTextured(job, file), 0};
  outcome.peak_bytes = memory.peak_bytes();
  EXPECT_EQ(memory.used_bytes(), 0u) << "all is given back";
  return outcome;
}

void ExpectLimit(const absl::Status& status) {
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  const auto numbers = LimitErrorOf(status);
  ASSERT_TRUE(numbers.has_value()) << status;
  EXPECT_GT(numbers->need_bytes, numbers->limit_bytes) << status;
}

TEST(HostileTest, InstancesWithoutDataCostNothing) {
  for (const ByteVector& file : {InstancesWithoutData(10'000'000), EmptyPrimitivesWithoutData(50, 10'000'000)}) {
    const Outcome outcome = LoadWithin(1024 * kMiB, file);
    ExpectLimit(outcome.status);
    EXPECT_LT(outcome.peak_bytes, kMiB);
  }
  EXPECT_TRUE(LoadWithin(256 * kMiB, InstancesWithoutData(1000)).status.ok()) << "what is small is good";
}

TEST(HostileTest, ManyOwnAttributesTakeMemoryOfTheirValues) {
  const Outcome outcome = LoadWithin(64 * kMiB, ManyOwnAttributes(3000));  // all vertices with all of them: 432 MB
  EXPECT_TRUE(outcome.status.ok()) << outcome.status;
}

TEST(HostileTest, TexelsAndLevelsAreChargedBeforeTheyAreMade) {
  // Texels and two kinds of levels of 4 Mi texels take 58 MiB, once, although four images show them.
  EXPECT_TRUE(LoadWithin(64 * kMiB, LargePngs(2048, 4)).status.ok());
  ExpectLimit(LoadWithin(32 * kMiB, LargePngs(2048, 4)).status);
}

TEST(HostileTest, JsonIsReadWithoutWhatTheLoaderDoesNotUse) {
  EXPECT_LT(LoadWithin(64 * kMiB, EmptyObjects(4 * kMiB, "extras")).peak_bytes, kMiB);
  EXPECT_LT(LoadWithin(64 * kMiB, EmptyObjects(4 * kMiB, "unknown")).peak_bytes, kMiB);
  ExpectLimit(LoadWithin(64 * kMiB, EmptyObjects(4 * kMiB, "nodes")).status);
}

// The longest time from a cancel to the end of `work`, which takes longer than that by itself.
void ExpectPromptCancel(const ByteVector& file) {
  MemoryBudget memory(uint64_t{4} << 30);
  double longest = 0;
  for (const milliseconds after : {milliseconds(1), milliseconds(20), milliseconds(80), milliseconds(200)}) {
    JobContext job;
    job.set_memory(&memory);
    std::chrono::steady_clock::time_point cancelled;
    std::thread canceller([&] {
      std::this_thread::sleep_for(after);
      cancelled = std::chrono::steady_clock::now();
      job.Cancel();
    });
    const absl::Status status = LoadTextured(job, file);
    const auto end = std::chrono::steady_clock::now();
    canceller.join();
    if (status.code() != absl::StatusCode::kCancelled) continue;  // it was done before
    longest = std::max(longest, std::chrono::duration<double, std::milli>(end - cancelled).count());
    EXPECT_LT(end - cancelled, milliseconds(500 * kSlowdown)) << after.count();
  }
  std::cout << file.size() << " bytes: ended at most " << longest << " ms after the cancel" << std::endl;
  EXPECT_EQ(memory.used_bytes(), 0u);
}

TEST(HostileTest, CancelReachesJson) {
  ExpectPromptCancel(EmptyObjects(32 * kMiB, "extras"));
  ExpectPromptCancel(EmptyObjects(2 * kMiB, "nodes"));
}

// `head`, then `part` over and over up to `bytes`, then `tail`.
ByteVector Repeated(std::string_view head, std::string_view part, uint64_t bytes, std::string_view tail = "") {
  ByteVector file(head.begin(), head.end());
  file.reserve(bytes + part.size() + tail.size());
  while (file.size() < bytes) file.insert(file.end(), part.begin(), part.end());
  file.insert(file.end(), tail.begin(), tail.end());
  return file;
}

// Texts that say nothing, of which telling the format apart takes longest, too.
TEST(HostileTest, CancelReachesBlankLinesAndComments) {
  constexpr uint64_t kBytes = 48 * kMiB;
  ExpectPromptCancel(Repeated("", "\n", kBytes));
  ExpectPromptCancel(Repeated("", "#\n", kBytes));
  ExpectPromptCancel(Repeated("", "g\r", kBytes));
  ExpectPromptCancel(Repeated("OFF\n1 0 0\n0 0 0\n", "\n", kBytes));
  ExpectPromptCancel(Repeated("ply\nformat ascii 1.0\n", "comment\n", kBytes));
  ExpectPromptCancel(
      Repeated("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
               "property float z\nend_header\n",
               " ", kBytes));
}

TEST(HostileTest, CancelReachesLongLines) {
  constexpr uint64_t kBytes = 48 * kMiB;
  ExpectPromptCancel(Repeated("solid\n", "endloop ", kBytes));
  ExpectPromptCancel(Repeated("v 0 0 0\nf", " 1", kBytes / 4));
  ExpectPromptCancel(Repeated("v 0 0 0\n", "\\\n", kBytes));
  ExpectPromptCancel(Repeated("v 0 0 0\nmtllib data:,newmtl%20a%0Amap_Kd", "%20-bm%20x", kBytes));
  ExpectPromptCancel(Repeated("v 0 0 0\nmtllib data:,a", " x", kBytes));
  ExpectPromptCancel(Repeated("OFF\n1 1 0\n0 0 0\n20000000", " 0", kBytes));
}

TEST(HostileTest, CancelReachesOneFaceOfManyCorners) {
  constexpr uint32_t kCorners = 40'000'000;
  std::string head =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uint uchar vertex_indices\nend_header\n";
  head.append(12, '\0');
  head.append(reinterpret_cast<const char*>(&kCorners), sizeof kCorners);
  ExpectPromptCancel(Repeated(head, std::string_view("\0", 1), head.size() + kCorners));
}

TEST(HostileTest, CancelReachesChunksOfNothing) {
  ByteVector glb =
      Repeated(std::string_view("glTF\2\0\0\0....\2\0\0\0JSON{}", 22), std::string_view("\0\0\0\0none", 8), 48 * kMiB);
  const auto length = uint32_t(glb.size());
  std::memcpy(glb.data() + 8, &length, sizeof length);
  ExpectPromptCancel(glb);
}

// Each reference once compared the names of all entries, and each object copied all values of its group.
TEST(HostileTest, EntriesAndReferencesOf3mfAreNotMultiplied) {
  constexpr char kMesh[] =
      "<mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>"
      "<vertex x=\"0\" y=\"1\" z=\"0\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" "
      "v3=\"2\"/></triangles></mesh>";
  const auto load = [](const std::string& file) {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + std::chrono::seconds(10 * kSlowdown));
    return LoadSceneFor(job, ByteVector(file.begin(), file.end())).status();
  };
  std::string items;
  for (int i = 0; i < 50'000; ++i) items += "<item objectid=\"1\" path=\"/3D/PART.model\"/>";
  ZipMaker zip = Package3mf(Model3mf("", items));
  zip.Add("3D/part.model", Model3mf(absl::StrCat("<object id=\"1\">", kMesh, "</object>"), ""));
  for (int i = 0; i < 50'000; ++i) zip.Add(std::to_string(i), "", false);
  EXPECT_TRUE(load(zip.Bytes()).ok());

  std::string resources = "<colorgroup id=\"1\">";
  for (int i = 0; i < 500'000; ++i) resources += "<color color=\"#123456\"/>";
  resources += "</colorgroup>";
  items.clear();
  for (int i = 2; i < 5000; ++i) {
    absl::StrAppend(&resources, "<object id=\"", i, "\" pid=\"1\" pindex=\"0\">", kMesh, "</object>");
    absl::StrAppend(&items, "<item objectid=\"", i, "\"/>");
  }
  EXPECT_TRUE(load(Package3mf(Model3mf(resources, items)).Bytes()).ok());
}

TEST(HostileTest, CancelReachesPrimitivesAndTargets) {
  ExpectPromptCancel(PrimitivesWithoutData(5000, 60));
  ExpectPromptCancel(TargetsWithoutData(200'000, 1));
  ExpectPromptCancel(EmptyObjects(kMiB, "animations"));
}

TEST(HostileTest, CancelReachesImagesAndLevels) {
  ExpectPromptCancel(LargePngs(4096, 1));
}

TEST(HostileTest, CancelReachesPlacementsAndAttributes) {
  ExpectPromptCancel(ManyOwnAttributes(20'000));
  GlbBuilder builder;
  builder.Mesh(builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  const int places = builder.Vectors(std::vector<float>(3'000'000, 1.0f), "VEC3");
  builder.Scene({builder.Node(
      {{"mesh", 0}, {"extensions", {{"EXT_mesh_gpu_instancing", {{"attributes", {{"TRANSLATION", places}}}}}}}})});
  ExpectPromptCancel(builder.Glb());
}

}  // namespace
}  // namespace voxelpipe
