// Several stored meshes on one grid, each placed by a matrix.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/calls/placed_fixture.h"
#include "service/support/effort.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"

namespace voxelpipe::testing {
namespace {

// A turn, a shear and a mirror.
Mat4d Mirrored() {
  Mat4d m = Moved(0.25, -1.5, 3);
  m.m[0][0] = 0;
  m.m[0][1] = 1.25;
  m.m[1][0] = 0.75;
  m.m[1][1] = 0.125;
  return m;
}

TEST_F(PlacedMeshesTest, TheBytesAreThoseOfPlacingHere) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  const std::vector<std::vector<PlacedStored>> lists{
      {{torus_}},
      {{torus_}, {slab_, Moved(1, 0.5, 0)}},
      {{slab_, Mirrored(), "a"}, {torus_, Moved(-2, 0, 1), "b", 7, -3}, {slab_, Moved(0, 0, 0.125), "a", 7}}};
  for (const auto& list : lists) {
    for (const VoxelizeRequest& request : Requests()) ExpectAsHere(list, request);
  }
  VoxelizeRequest sparse = SmallRequest();
  sparse.result = ResultKind::kSparse;
  ExpectAsHere(lists[2], sparse);
}

TEST_F(PlacedMeshesTest, OneThatIsNotMovedIsTheStoredMesh) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  for (const VoxelizeRequest& request : Requests()) {
    EXPECT_EQ(HashOfPlaced({{torus_}}, request), HashOfStored(torus_, request));
  }
}

TEST_F(PlacedMeshesTest, OneMeshMayBePlacedManyTimes) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  std::vector<PlacedStored> row;
  for (int i = 0; i < 9; ++i) row.push_back({torus_, Moved(2.5 * i, 0, 0)});
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 90;
  ExpectAsHere(row, request);
  const auto mesh = client_->GetMesh(torus_);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->uses, 1u) << "one job";
}

// Nothing but a matrix travels.
TEST_F(PlacedMeshesTest, APartThatMovesIsTheSameListWithAnotherMatrix) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  VoxelizeRequest request = SmallRequest();
  request.fill = Fill::kNonzero;
  for (int frame = 0; frame < 4; ++frame) {
    ExpectAsHere({{torus_}, {slab_, Moved(0, 0.3 * frame, 0)}}, request);
  }
}

TEST_F(PlacedMeshesTest, EachHasTheVelocityOfItsMotion) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 40;
  TargetSpec& target = request.targets[0];
  target.format = VoxelFormat::kF32;
  target.components = 3;
  target.blend = Blend::kReplace;
  target.shader = {"velocity", {}};
  const RigidMotionNumbers turning{{0, 0, 1}, {0, 2, 0}, {5, 0, 0}}, sliding{{3, 0, 0}, {}, {}};
  ExpectAsHere({{torus_, Moved(5, 0, 0), "wheel", 1, 0, turning}, {slab_, Mat4d(), "cart", 2, 0, sliding}, {slab_}},
               request);
  const std::string still = HashOfPlaced({{torus_}}, request);
  EXPECT_NE(HashOfPlaced({{torus_, Mat4d(), "", {}, 0, sliding}}, request), still);
}

TEST_F(PlacedMeshesTest, AllCallsTakeThem) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  const std::vector<PlacedStored> list{{torus_}, {slab_, Moved(1, 0.5, 0)}};
  for (const auto& [call, status] : StatusesOf(PlacedRequestOf(SmallRequest(), list))) {
    EXPECT_TRUE(status.ok()) << call << ": " << status.error_message();
  }
  const auto one = client_->VoxelizePlaced(list, SmallRequest(), job_);
  ASSERT_TRUE(one.ok()) << one.status();
  const auto estimated = client_->EstimatePlaced(list, SmallRequest(), job_);
  ASSERT_TRUE(estimated.ok()) << estimated.status();
  EXPECT_EQ(estimated->plan.grid, one->result.grid);
  EXPECT_EQ(estimated->report.triangles, one->report.triangles);
  EXPECT_EQ(estimated->report.vertices, one->report.vertices);

  // Many on one stream: frames of a part that moves.
  const auto stream = client_->OpenMany(job_);
  std::vector<std::string> expected;
  constexpr uint64_t kFrames = 12;
  for (uint64_t frame = 0; frame < kFrames; ++frame) {
    const std::vector<PlacedStored> moved{{torus_}, {slab_, Moved(0.2 * double(frame), 0, 0)}};
    ASSERT_TRUE(stream->SendPlaced(frame, moved, SmallRequest()).ok());
    const auto local = Local(moved, SmallRequest());
    ASSERT_TRUE(local.ok()) << local.status();
    expected.push_back(Bytes(*local));
  }
  stream->FinishSending();
  for (uint64_t frame = 0; frame < kFrames; ++frame) {
    const absl::StatusOr<ManyAnswer> answer = stream->Receive();
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_TRUE(answer->result.ok()) << answer->result.status();
    EXPECT_TRUE(Bytes(answer->result->result) == expected[answer->id]) << answer->id;
  }
}

TEST_F(PlacedMeshesTest, NoMeshBytesMayFollow) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  const v1::VoxelizeRequest request = PlacedRequestOf(SmallRequest(), {{torus_}});
  const grpc::Status status = CallUpload(*stub_, {UploadOf(request), PieceOf("glTF")}).status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "mesh.placed: no mesh bytes may follow");
}

TEST_F(PlacedMeshesTest, AHeldMeshServesItsJobToTheEnd) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "2"}));
  const std::vector<uint8_t> slow = LargeTrianglesGlb(LessIfSlow(2000));
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  std::string expected;
  for (const bool deleted : {false, true}) {
    const std::vector<PlacedStored> list{{Upload(slow).name}, {Upload(glb_).name, Moved(0.5, 0, 0)}};
    std::promise<void> planned;
    auto running = std::async(std::launch::async, [&] {
      return client_->VoxelizePlaced(list, request, job_, [&](const Plan&) { planned.set_value(); });
    });
    ASSERT_EQ(planned.get_future().wait_for(kPatience), std::future_status::ready);
    if (deleted) {
      for (const PlacedStored& placed : list) EXPECT_TRUE(client_->DeleteMesh(placed.mesh).ok());
    }
    const auto result = running.get();
    ASSERT_TRUE(result.ok()) << result.status();
    if (!deleted) expected = result->content_sha256;
    EXPECT_EQ(result->content_sha256, expected);
  }
}

// The job waits in the queue while others take the room of its meshes.
TEST_F(PlacedMeshesTest, EvictionDoesNotTakeTheMeshesOfAWaitingJob) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  const uint64_t room = client_->GetMesh(torus_)->memory_bytes + client_->GetMesh(slab_)->memory_bytes;
  const std::vector<PlacedStored> list{{torus_}, {slab_, Moved(1, 0.5, 0)}};
  const std::string expected = HashOfPlaced(list);
  ASSERT_NO_FATAL_FAILURE(
      StartWithMeshes({"--workers", "1", "--threads", "1", "--max-mesh-store-bytes", std::to_string(room + room / 8)}));
  JobContext slow_job;
  std::promise<void> began;
  const std::vector<uint8_t> endless = LargeTrianglesGlb(20000);
  auto slow = std::async(std::launch::async, [&] {
    return client_
        ->Voxelize(endless, MeshFormat::kGlb, SlowRequest(), slow_job, [&](const Plan&) { began.set_value(); })
        .status();
  });
  ASSERT_EQ(began.get_future().wait_for(kPatience), std::future_status::ready);
  auto waiting = std::async(std::launch::async, [&] { return client_->VoxelizePlaced(list, SmallRequest(), job_); });
  while (client_->GetMesh(slab_).value_or(StoredMesh{}).uses < 1) std::this_thread::yield();
  Upload(TorusGlb(11));
  Upload(TorusGlb(6));
  EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(torus_).status()));
  EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(slab_).status()));
  slow_job.Cancel();
  EXPECT_TRUE(absl::IsCancelled(slow.get()));
  const auto result = waiting.get();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->content_sha256, expected);
}

// What a result depends on is what decides if it is another's.
TEST_F(PlacedMeshesTest, EqualListsAreOneRunAndAllOthersTheirOwn) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes({"--result-cache-bytes", "64MiB"}));
  const std::vector<PlacedStored> list{{torus_, Moved(0, 0, 0)}, {slab_, Moved(1, 0.5, 0)}};
  const auto is_cached = [&](const std::vector<PlacedStored>& meshes) {
    const auto result = client_->VoxelizePlaced(meshes, SmallRequest(), job_);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() && result->cached;
  };
  EXPECT_FALSE(is_cached(list));
  EXPECT_TRUE(is_cached(list));
  // Defaults that are written out, and a zero of the other sign.
  std::vector<PlacedStored> equal = list;
  equal[0].name = torus_;
  equal[1].label = 2;
  equal[1].matrix.m[2][0] = -0.0;
  EXPECT_TRUE(is_cached(equal));
  const std::vector<std::function<void(PlacedStored&)>> changes{
      [](PlacedStored& mesh) { mesh.matrix.m[1][3] = std::nextafter(0.5, 1); },
      [](PlacedStored& mesh) { mesh.name = "other"; },
      [](PlacedStored& mesh) { mesh.label = 3; },
      [](PlacedStored& mesh) { mesh.priority = 1; },
      [](PlacedStored& mesh) { mesh.motion.emplace(); },
      [](PlacedStored& mesh) { mesh.motion.emplace().center.z = 1; },
      [this](PlacedStored& mesh) { mesh.mesh = torus_; },
  };
  for (size_t i = 0; i < changes.size(); ++i) {
    std::vector<PlacedStored> other = list;
    changes[i](other[1]);
    EXPECT_FALSE(is_cached(other)) << i;
    EXPECT_TRUE(is_cached(other)) << i;
  }
  EXPECT_FALSE(is_cached({list[1], list[0]})) << "the order";
  EXPECT_FALSE(is_cached({list[0]}));
  EXPECT_TRUE(is_cached(list));
  // A result is not given to who names a mesh that is gone.
  ASSERT_TRUE(client_->DeleteMesh(slab_).ok());
  EXPECT_TRUE(absl::IsNotFound(client_->VoxelizePlaced(list, SmallRequest(), job_).status()));
}

TEST_F(PlacedMeshesTest, EqualListsAtTheSameTimeAreComputedOnce) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "2"}));
  const std::string slow = Upload(LargeTrianglesGlb(LessIfSlow(1500))).name;
  const std::vector<PlacedStored> list{{slow}, {slow, Moved(0.5, 0, 0)}};
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  std::vector<std::future<absl::StatusOr<RemoteResult>>> calls;
  for (int i = 0; i < 8; ++i) {
    calls.push_back(std::async(std::launch::async, [&] { return client_->VoxelizePlaced(list, request, job_); }));
  }
  int computed = 0;
  std::string hash;
  for (auto& call : calls) {
    const auto result = call.get();
    ASSERT_TRUE(result.ok()) << result.status();
    if (!result->cached) ++computed;
    if (hash.empty()) hash = result->content_sha256;
    EXPECT_EQ(result->content_sha256, hash);
  }
  EXPECT_EQ(computed, 1);
}

// What is placed counts as memory of its request.
TEST_F(PlacedMeshesTest, TheCopyIsChargedToTheRequest) {
  ASSERT_NO_FATAL_FAILURE(Start({"--max-working-bytes", "64MiB"}));
  const StoredMesh mesh = Upload(TorusGlb(100));
  const uint64_t each = mesh.report.vertices * 24 + mesh.report.triangles * 12;
  std::vector<PlacedStored> list((uint64_t{64} << 20) / each + 1, {mesh.name});
  const absl::Status status = client_->VoxelizePlaced(list, SmallRequest(), job_).status();
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
  EXPECT_NE(std::string(status.message()).find("placed meshes"), std::string::npos) << status;
  list.resize(4);
  const auto few = client_->VoxelizePlaced(list, SmallRequest(), job_);
  ASSERT_TRUE(few.ok()) << few.status();
  EXPECT_GE(few->peak_bytes, 4 * each);
}

// An error of a texture says in which mesh it is; a warning of a mesh has its name.
TEST_F(PlacedMeshesTest, FaultsAreThoseOfTheMeshThatHasThem) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<uint8_t> broken = glb_;
  const std::array<uint8_t, 4> end{'I', 'D', 'A', 'T'};
  const auto at = std::search(broken.begin(), broken.end(), end.begin(), end.end());
  ASSERT_NE(at, broken.end());
  *(at + 8) ^= 0xff;
  const std::vector<PlacedStored> list{{Upload(glb_).name}, {Upload(broken).name, Mat4d(), "the broken one"}};
  VoxelizeRequest request = Requests()[1];
  const absl::Status status = client_->VoxelizePlaced(list, request, job_).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
  EXPECT_TRUE(std::string(status.message()).starts_with("mesh.placed.meshes[1]: ")) << status;
  EXPECT_TRUE(client_->VoxelizePlaced(list, SmallRequest(), job_).ok()) << "no shader reads it";
}

}  // namespace
}  // namespace voxelpipe::testing
