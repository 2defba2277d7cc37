#include "meshes/mesh_store.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "jobs/prepare_kept.h"
#include "jobs/request_memory.h"
#include "mesh/content_id.h"
#include "mesh/mesh_bytes.h"
#include "support/warnings.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// A PNG of one pixel, as small encoders write it.
const std::vector<uint8_t> kPixel = {0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48,
                                     0x44, 0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x00, 0x00, 0x00,
                                     0x00, 0x3a, 0x7e, 0x9b, 0x55, 0x00, 0x00, 0x00, 0x0a, 0x49, 0x44, 0x41, 0x54, 0x78,
                                     0x9c, 0x63, 0x68, 0x00, 0x00, 0x00, 0x82, 0x00, 0x81, 0x77, 0xcd, 0x72, 0xb6, 0x00,
                                     0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};

std::string NameOf(char digit) {
  return "meshes/" + std::string(64, digit);
}

// One triangle with a base colour and an emissive texture.
LoadedMesh Triangle(std::vector<uint8_t> base = kPixel, std::vector<uint8_t> emissive = kPixel) {
  LoadedMesh loaded;
  TriangleMesh& mesh = loaded.mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}};
  mesh.parts.resize(1);
  mesh.parts[0].triangle_count = 1;
  mesh.parts[0].material = 0;
  mesh.parts[0].vertex_count = 3;
  mesh.materials.resize(1);
  mesh.materials[0].base_color.texture = 0;
  mesh.materials[0].emissive.texture = 1;
  mesh.textures.resize(2);
  for (int i = 0; i < 2; ++i) {
    mesh.textures[size_t(i)].image = i;
    mesh.textures[size_t(i)].mip_filter = MipFilter::kNone;
    mesh.images.push_back(std::make_shared<Image>());
    mesh.images.back()->encoded = i == 0 ? base : emissive;
  }
  loaded.mesh.warnings.Add(WarningCode::kNoScene, "", "a warning");
  return loaded;
}

std::shared_ptr<KeptMesh> Kept(char digit, LoadedMesh loaded = Triangle()) {
  return *KeptMesh::Make({}, NameOf(digit), MeshFormat::kGlb, 100, std::move(loaded));
}

constexpr TextureUse kBase{true, false, false}, kEmissive{false, true, false}, kNone{};

TEST(MeshStoreTest, WhatIsNotThereIsNotFoundByName) {
  MeshStore store(1 << 20);
  EXPECT_EQ(MissingMesh(store.Get(NameOf('a')).status()), NameOf('a'));
  EXPECT_EQ(MissingMesh(store.Take(NameOf('a')).status()), NameOf('a'));
  EXPECT_EQ(MissingMesh(store.Delete(NameOf('a')).status()), NameOf('a'));
  EXPECT_TRUE(absl::IsNotFound(store.Get(NameOf('a')).status()));
}

TEST(MeshStoreTest, TakingCountsAndLookingDoesNot) {
  MeshStore store(1 << 20);
  ASSERT_TRUE(store.Insert(Kept('a'), "x").ok());
  ASSERT_TRUE(store.Get(NameOf('a')).ok());
  EXPECT_EQ((*store.Get(NameOf('a')))->uses(), 0u);
  ASSERT_TRUE(store.Take(NameOf('a')).ok());
  EXPECT_EQ((*store.Get(NameOf('a')))->uses(), 1u);
  EXPECT_EQ(store.stats().hits, 1u);
}

TEST(MeshStoreTest, AMeshLargerThanTheStoreSaysNeedAndLimit) {
  MeshStore store(100);
  const auto mesh = Kept('a');
  const absl::Status status = store.Insert(mesh, "x").status();
  EXPECT_TRUE(absl::IsResourceExhausted(status));
  const auto numbers = LimitErrorOf(status);
  ASSERT_TRUE(numbers.has_value());
  EXPECT_EQ(numbers->need_bytes, mesh->memory_bytes());
  EXPECT_EQ(numbers->limit_bytes, 100u);
}

TEST(MeshStoreTest, ADeletedMeshServesWhoHasIt) {
  MeshStore store(1 << 20);
  ASSERT_TRUE(store.Insert(Kept('a'), "x").ok());
  const auto held = store.Take(NameOf('a'));
  ASSERT_TRUE(held.ok());
  ASSERT_TRUE(store.Delete(NameOf('a')).ok());
  const auto mesh = store.Mesh({}, **held, kBase, {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ((*mesh)->triangles.size(), 1u);
  EXPECT_EQ(store.stats().bytes, 0u);
}

TEST(KeptMeshTest, TexturesAreDecodedOnceIntoAMeshOfItsOwn) {
  const auto kept = Kept('a');
  const auto plain = *kept->Mesh({}, kNone, {});
  EXPECT_EQ(plain->content_id, NameOf('a'));
  EXPECT_TRUE(kept->ready(kNone));
  EXPECT_FALSE(kept->ready(kBase));
  const uint64_t before = kept->memory_bytes();
  const auto based = kept->Mesh({}, kBase, {});
  ASSERT_TRUE(based.ok()) << based.status();
  EXPECT_TRUE(plain->images[0]->rgba.empty()) << "who has the mesh already sees nothing of it";
  EXPECT_EQ((*based)->images[0]->rgba.size(), 4u);
  EXPECT_TRUE((*based)->images[1]->rgba.empty()) << "nobody reads it";
  EXPECT_NE((*based)->content_id, plain->content_id);
  EXPECT_GT(kept->memory_bytes(), before);
  EXPECT_EQ(*kept->Mesh({}, kBase, {}), *based) << "the same object";
  EXPECT_EQ(*kept->Mesh({}, kNone, {}), *based) << "which serves who reads no textures, too";
  const auto both = kept->Mesh({}, kEmissive, {});
  ASSERT_TRUE(both.ok()) << both.status();
  EXPECT_EQ((*both)->images[0]->rgba.size(), 4u) << "what was decoded stays";
  EXPECT_EQ((*both)->images[1]->rgba.size(), 4u);
  EXPECT_TRUE((*based)->images[1]->rgba.empty());
}

TEST(KeptMeshTest, ABrokenTextureFailsThoseWhoReadIt) {
  std::vector<uint8_t> broken = kPixel;
  broken.resize(40);
  const auto kept = Kept('a', Triangle(kPixel, broken));
  EXPECT_TRUE(absl::IsInvalidArgument(kept->Mesh({}, kEmissive, {}).status()));
  EXPECT_TRUE(kept->Mesh({}, kBase, {}).ok());
  EXPECT_TRUE(absl::IsInvalidArgument(kept->Mesh({}, kEmissive, {}).status())) << "the next time too";
}

TEST(MeshStoreTest, DecodedTexturesCount) {
  const LoadLimits limits;
  const auto kept = Kept('a');
  MeshStore store(kept->memory_bytes() + 2);  // one pixel takes four bytes
  ASSERT_TRUE(store.Insert(kept, "x").ok());
  ASSERT_TRUE(store.Mesh({}, *kept, kNone, limits).ok());
  EXPECT_TRUE(store.Get(NameOf('a')).ok());
  ASSERT_TRUE(store.Mesh({}, *kept, kBase, limits).ok()) << "who has it may use it";
  EXPECT_TRUE(absl::IsNotFound(store.Get(NameOf('a')).status())) << "but there is no room to keep it";
  EXPECT_EQ(store.stats().bytes, 0u);
}

TEST(KeptMeshTest, ManyThreadsGetTheSameTextures) {
  const auto kept = Kept('a');
  std::vector<std::thread> threads;
  std::vector<std::shared_ptr<const TriangleMesh>> meshes(16);
  for (size_t i = 0; i < meshes.size(); ++i) {
    threads.emplace_back([&, i] { meshes[i] = *kept->Mesh({}, i % 4 == 0 ? kNone : kBase, {}); });
  }
  for (std::thread& thread : threads) thread.join();
  for (size_t i = 0; i < meshes.size(); ++i) {
    if (i % 4 == 0) continue;
    EXPECT_EQ(meshes[i], meshes[1]) << "decoded once";
  }
}

// Who prepares it may wait for memory for as long as its own patience lasts.
TEST(KeptMeshTest, AJobEndsInTimeThoughAnotherPreparesTheSameMesh) {
  const auto kept = Kept('a');
  ByteBudget working(1 << 20);
  JobContext other_job, slow_job, late_job, cancelled_job;
  const auto other = MakeRequestMemory(working, other_job), slow = MakeRequestMemory(working, slow_job);
  ASSERT_TRUE(other->Take(1 << 20, "all there is").ok());
  absl::Status prepared;
  std::thread thread([&] { prepared = kept->Mesh(slow_job, kBase, {}).status(); });
  while (slow->used_bytes() == 0) std::this_thread::yield();  // it waits now
  late_job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(50));
  EXPECT_TRUE(absl::IsDeadlineExceeded(kept->Mesh(late_job, kEmissive, {}).status()));
  EXPECT_TRUE(absl::IsDeadlineExceeded(kept->Examine(late_job).status()));
  cancelled_job.Cancel();
  EXPECT_TRUE(absl::IsCancelled(kept->Mesh(cancelled_job, kEmissive, {}).status()));
  other->Give(1 << 20);
  thread.join();
  EXPECT_TRUE(prepared.ok()) << prepared;
  EXPECT_TRUE(kept->Mesh({}, kEmissive, {}).ok());
}

TEST(KeptMeshTest, EdgesAreCountedWhenSomebodyAsks) {
  const auto kept = Kept('a');
  EXPECT_FALSE(kept->Report().examined);
  EXPECT_EQ(kept->Examine({})->report.open_edges, 3u);
  EXPECT_TRUE(kept->Report().examined) << "known from then on";
  EXPECT_EQ(kept->Report().report.open_edges, 3u);
}

TEST(KeptMeshTest, NamesCountAsMemory) {
  LoadedMesh named = Triangle();
  named.mesh.materials[0].name = std::string(1 << 20, 'n');
  EXPECT_GT(Kept('a', std::move(named))->memory_bytes(), uint64_t{1} << 20);
}

TEST(MeshStoreTest, AClaimGoesWithItsClientAndTheMeshWithTheLastClaim) {
  MeshStore store(1 << 20);
  EXPECT_TRUE(absl::IsNotFound(store.Release(NameOf('a'), "x").status()));
  ASSERT_TRUE(store.Insert(Kept('a'), "x").ok());
  ASSERT_TRUE(store.Insert(Kept('a'), "y").ok()) << "an equal one";
  ASSERT_NE(store.Claim(NameOf('a'), "x"), nullptr);
  ASSERT_NE(store.Touch(NameOf('a')), nullptr);
  EXPECT_TRUE(absl::IsPermissionDenied(store.Release(NameOf('a'), "z").status())) << "who names a mesh has no claim";
  const auto first = store.Release(NameOf('a'), "x");
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(*first, nullptr) << "it stays for the other";
  EXPECT_TRUE(absl::IsPermissionDenied(store.Release(NameOf('a'), "x").status()));
  EXPECT_TRUE(store.Get(NameOf('a')).ok());
  const auto last = store.Release(NameOf('a'), "y");
  ASSERT_TRUE(last.ok()) << last.status();
  EXPECT_NE(*last, nullptr);
  EXPECT_TRUE(absl::IsNotFound(store.Get(NameOf('a')).status()));
  EXPECT_EQ(store.stats().evictions, 0u);
}

TEST(MeshStoreTest, AListHasTheClaimsOfAClientTheNewestFirst) {
  MeshStore store(1 << 20);
  for (const char digit : {'a', 'b', 'c', 'd'}) ASSERT_TRUE(store.Insert(Kept(digit), digit == 'b' ? "y" : "x").ok());
  ASSERT_NE(store.Claim(NameOf('a'), "y"), nullptr);
  ASSERT_NE(store.Touch(NameOf('a')), nullptr);
  const auto list = [&](const std::string* client, std::optional<uint64_t> before, size_t count) {
    std::string digits;
    uint64_t last = before.value_or(UINT64_MAX);
    for (const MeshStore::Listed& mesh : store.List(client, before, count)) {
      EXPECT_LT(mesh.number, last);
      last = mesh.number;
      digits += mesh.value->name().back();
    }
    return digits;
  };
  const std::string x = "x", y = "y", z = "z";
  EXPECT_EQ(list(nullptr, {}, 10), "dcba");
  EXPECT_EQ(list(&x, {}, 10), "dca");
  EXPECT_EQ(list(&y, {}, 10), "ba");
  EXPECT_EQ(list(&z, {}, 10), "");
  EXPECT_EQ(list(&x, {}, 2), "dc");
  EXPECT_EQ(list(&x, store.List(&x, {}, 2).back().number, 2), "a");
  EXPECT_EQ(list(nullptr, store.List(nullptr, {}, 1).back().number, 2), "cb");
  EXPECT_EQ(store.stats().hits, 0u) << "it is no use";
}

TEST(MeshStoreTest, AMeshThatOthersSharesLeaveNoRoomForSaysNeedAndLimit) {
  const uint64_t each = Kept('a')->memory_bytes();
  MeshStore store(each * 2 + each / 2);
  ASSERT_TRUE(store.Insert(Kept('a'), "x").ok());
  LoadedMesh large = Triangle();
  large.mesh.positions.resize(3 + each / 24);
  const auto mesh = Kept('b', std::move(large));
  ASSERT_GT(mesh->memory_bytes(), each + each / 2);
  ASSERT_LT(mesh->memory_bytes(), store.max_bytes());
  const absl::Status status = store.Insert(mesh, "y").status();
  ASSERT_TRUE(absl::IsResourceExhausted(status)) << status;
  const auto numbers = LimitErrorOf(status);
  ASSERT_TRUE(numbers);
  EXPECT_EQ(numbers->need_bytes, mesh->memory_bytes());
  EXPECT_EQ(numbers->limit_bytes, store.max_bytes() - each);
  EXPECT_TRUE(store.Get(NameOf('a')).ok()) << "what does not fit puts nothing out";
}

TEST(MeshStoreTest, AListIsTakenAsAWhole) {
  MeshStore store(1 << 20);
  const auto a = Kept('a'), b = Kept('b');
  ASSERT_TRUE(store.Insert(a, "x").ok());
  ASSERT_TRUE(store.Insert(b, "x").ok());
  const std::vector<PlacedStored> list{{NameOf('a')}, {NameOf('b')}, {NameOf('a')}};
  const auto got = store.GetAll(list);
  ASSERT_TRUE(got.ok()) << got.status();
  EXPECT_EQ(*got, (std::vector<std::shared_ptr<KeptMesh>>{a, b, a}));
  EXPECT_EQ(a->uses(), 0u);
  const auto taken = store.TakeAll(list);
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_EQ(*taken, *got);
  EXPECT_EQ(a->uses(), 1u) << "of one job";
  EXPECT_EQ(b->uses(), 1u);
  const std::vector<PlacedStored> some{{NameOf('c')}, {NameOf('a')}, {NameOf('d')}, {NameOf('c')}};
  EXPECT_EQ(MissingMeshes(store.TakeAll(some).status()), (std::vector<std::string>{NameOf('c'), NameOf('d')}));
  EXPECT_EQ(MissingMeshes(store.GetAll(some).status()), (std::vector<std::string>{NameOf('c'), NameOf('d')}));
  EXPECT_EQ(a->uses(), 1u);
}

class PrepareKeptTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::shared_ptr<const PreparedMesh>> Prepare(const std::vector<float>& positions = {}) {
    return PrepareKept(store_, {&kept_, 1},
                       {reinterpret_cast<const uint8_t*>(positions.data()), positions.size() * sizeof(float)}, config_,
                       {}, job_);
  }

  MeshStore store_{1 << 20};
  const std::shared_ptr<KeptMesh> kept_ = Kept('a');
  ParsedConfig config_;
  JobContext job_;
};

TEST_F(PrepareKeptTest, JobsShareTheMesh) {
  const auto a = Prepare(), b = Prepare();
  ASSERT_TRUE(a.ok()) << a.status();
  ASSERT_TRUE(b.ok()) << b.status();
  EXPECT_EQ((*a)->mesh, (*b)->mesh);
  EXPECT_EQ(testing::Lines((*a)->mesh->warnings), std::vector<std::string>{"a warning"});
  EXPECT_FALSE((*a)->examined);
  config_.request.fill = Fill::kParity;
  const auto filled = Prepare();
  ASSERT_TRUE(filled.ok()) << filled.status();
  EXPECT_TRUE((*filled)->examined);
  EXPECT_EQ((*filled)->report.open_edges, 3u);
}

TEST_F(PrepareKeptTest, NewPositionsAreAMeshOfTheirOwn) {
  config_.new_positions = true;
  const auto moved = Prepare({0, 0, 5, 2, 0, 5, 0, 2, 5});
  ASSERT_TRUE(moved.ok()) << moved.status();
  const TriangleMesh& mesh = *(*moved)->mesh;
  EXPECT_EQ(mesh.positions[1], (Vec3d{2, 0, 5}));
  EXPECT_EQ(mesh.triangles.size(), 1u);
  EXPECT_NE(mesh.content_id, NameOf('a')) << "a device must not take it for the mesh that it has";
  EXPECT_EQ(SharedArraysOf(mesh.content_id).id, NameOf('a')) << "but for its positions";
  EXPECT_FALSE(SharedArraysOf(mesh.content_id).positions);
  EXPECT_EQ((*moved)->report.max, (Vec3d{2, 2, 5}));
  EXPECT_EQ((*kept_->Mesh({}, {}, {}))->positions[1], (Vec3d{1, 0, 0}));
}

// Frame after frame nothing but positions is written; frames at the same time do not disturb each other.
TEST_F(PrepareKeptTest, ACopyServesOneMoveAfterTheOther) {
  config_.new_positions = true;
  auto first = Prepare({0, 0, 1, 1, 0, 1, 0, 1, 1});
  ASSERT_TRUE(first.ok()) << first.status();
  const auto second = Prepare({0, 0, 2, 1, 0, 2, 0, 1, 2});
  ASSERT_TRUE(second.ok()) << second.status();
  const auto* indices = (*first)->mesh->triangles.data();
  const std::string id = (*first)->mesh->content_id;
  EXPECT_NE((*second)->mesh->triangles.data(), indices) << "the first is in use";
  EXPECT_NE((*second)->mesh->content_id, id);
  EXPECT_EQ((*first)->mesh->positions[0], (Vec3d{0, 0, 1}));
  first = absl::CancelledError();
  const auto third = Prepare({0, 0, 3, 1, 0, 3, 0, 1, 3});
  ASSERT_TRUE(third.ok()) << third.status();
  EXPECT_EQ((*third)->mesh->triangles.data(), indices) << "the same arrays";
  EXPECT_NE((*third)->mesh->content_id, id) << "with other positions";
  EXPECT_EQ((*third)->mesh->positions[0], (Vec3d{0, 0, 3}));
  EXPECT_EQ((*second)->mesh->positions[0], (Vec3d{0, 0, 2}));
}

TEST_F(PrepareKeptTest, TheCopyCountsAsMemoryAndOutlivesItsMesh) {
  config_.new_positions = true;
  ASSERT_TRUE(store_.Insert(kept_, "x").ok());
  const uint64_t before = store_.stats().bytes;
  auto moved = Prepare({0, 0, 1, 1, 0, 1, 0, 1, 1});
  ASSERT_TRUE(moved.ok()) << moved.status();
  EXPECT_EQ(store_.stats().bytes, 2 * before);
  EXPECT_TRUE(Prepare({0, 0, 1, 1, 0, 1, 0, 1, 1}).ok());
  EXPECT_EQ(store_.stats().bytes, 2 * before) << "one copy is kept";
  const std::shared_ptr<const TriangleMesh> mesh = (*moved)->mesh;
  moved = absl::CancelledError();
  ASSERT_TRUE(store_.Delete(NameOf('a')).ok());
  EXPECT_EQ(mesh->triangles.size(), 1u);
}

TEST_F(PrepareKeptTest, WrongPositionsAreNamed) {
  EXPECT_EQ(Prepare({1}).status(),
            absl::InvalidArgumentError("mesh.stored: no mesh bytes may follow, unless it has positions"));
  config_.new_positions = true;
  EXPECT_TRUE(absl::IsInvalidArgument(Prepare().status()));
  const absl::Status few = Prepare({0, 0, 0, 1, 1, 1, 2, 2}).status();
  EXPECT_EQ(few,
            absl::InvalidArgumentError("mesh.stored.positions: 36 bytes are wanted, x, y, z of 3 vertices; 32 came"));
  const absl::Status infinite = Prepare({0, 0, 0, 1, 1, 1e30f * 1e30f, 0, 0, 0}).status();
  EXPECT_EQ(infinite, absl::InvalidArgumentError("mesh.stored.positions: vertex 1 is not finite"));
}

TEST_F(PrepareKeptTest, PlacedMeshesAreOneMeshOfTheJob) {
  PlacedStored moved{NameOf('a'), Mat4d(), "moved", 9u, 0, {}};
  moved.matrix.m[2][3] = 5;
  config_.placed = std::make_shared<const std::vector<PlacedStored>>(
      std::vector<PlacedStored>{{NameOf('a'), Mat4d(), "still", 1u, 0, {}}, moved});
  config_.request.fill = Fill::kParity;
  MemoryBudget memory(1 << 20);
  job_.set_memory(&memory);
  const std::vector<std::shared_ptr<KeptMesh>> both{kept_, kept_};
  EXPECT_EQ(TrianglesOf(both), 2u);
  {
    const auto placed = PrepareKept(store_, both, {}, config_, {}, job_);
    ASSERT_TRUE(placed.ok()) << placed.status();
    const TriangleMesh& mesh = *(*placed)->mesh;
    EXPECT_EQ(mesh.triangles.size(), 2u);
    EXPECT_EQ(mesh.positions[4], (Vec3d{1, 0, 5}));
    EXPECT_EQ(mesh.content_id, "");
    ASSERT_EQ(mesh.placed.size(), 2u);
    EXPECT_EQ(mesh.placed[1].label, 9u);
    EXPECT_TRUE((*placed)->examined);
    EXPECT_EQ((*placed)->report.open_edges, 6u);
    EXPECT_EQ((*placed)->report.max.z, 5);
    EXPECT_GE(memory.used_bytes(), MeshBytes(mesh)) << "while the job has it";
    EXPECT_GE((*placed)->peak_bytes, memory.used_bytes());
  }
  EXPECT_EQ(memory.used_bytes(), 0u);
  const std::vector<uint8_t> bytes(4);
  EXPECT_EQ(PrepareKept(store_, both, bytes, config_, {}, job_).status(),
            absl::InvalidArgumentError("mesh.placed: no mesh bytes may follow"));
}

TEST_F(PrepareKeptTest, ACancelledJobStops) {
  job_.Cancel();
  EXPECT_TRUE(absl::IsCancelled(Prepare().status()));
}

}  // namespace
}  // namespace voxelpipe
