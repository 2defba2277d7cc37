// Several stored meshes on one grid, each placed by a matrix.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "google/rpc/error_details.pb.h"
#include "gtest/gtest.h"
#include "load/load_mesh.h"
#include "many_stream.h"
#include "mesh/placed_mesh.h"
#include "pipeline/voxelize.h"
#include "service/support/effort.h"
#include "service/support/mesh_store_fixture.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "shaders/catalog.h"
#include "wire/placed.h"
#include "wire/request.h"

namespace voxelpipe::testing {
namespace {

Mat4d Moved(double x, double y, double z) {
  Mat4d m;
  m.m[0][3] = x;
  m.m[1][3] = y;
  m.m[2][3] = z;
  return m;
}

// A turn, a shear and a mirror.
Mat4d Mirrored() {
  Mat4d m = Moved(0.25, -1.5, 3);
  m.m[0][0] = 0;
  m.m[0][1] = 1.25;
  m.m[1][0] = 0.75;
  m.m[1][1] = 0.125;
  return m;
}

v1::VoxelizeRequest PlacedRequestOf(const VoxelizeRequest& request, const std::vector<PlacedStored>& meshes,
                                    const CallSettings& settings = {}) {
  v1::VoxelizeRequest message = MakeRequest(request, settings);
  WriteTo(meshes, *message.mutable_mesh()->mutable_placed());
  return message;
}

std::string Bytes(const VoxelizeResult& result) {
  std::string all;
  for (const auto array : ArraysOf(result)) all.append(array.begin(), array.end());
  return all;
}

class PlacedMeshesTest : public MeshStoreTest {
 protected:
  // A server with two meshes.
  void StartWithMeshes(std::vector<std::string> arguments = {}) {
    ASSERT_NO_FATAL_FAILURE(Start(std::move(arguments)));
    torus_ = Upload(glb_).name;
    slab_ = Upload(slab_glb_).name;
  }

  // PlaceMeshes and Voxelize in this process.
  absl::StatusOr<VoxelizeResult> Local(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request) {
    std::map<std::string, std::shared_ptr<const TriangleMesh>> loaded;
    std::vector<PlacedMesh> list;
    for (const PlacedStored& placed : meshes) {
      std::shared_ptr<const TriangleMesh>& mesh = loaded[placed.mesh];
      if (!mesh) {
        absl::StatusOr<LoadedMesh> file =
            LoadMeshFor(job_, placed.mesh == torus_ ? glb_ : slab_glb_, {{}, TexturesRead(request), {}});
        if (!file.ok()) return file.status();
        mesh = std::make_shared<const TriangleMesh>(std::move(file->mesh));
      }
      list.push_back({mesh, placed.matrix, placed.name, placed.label, placed.priority, placed.motion});
    }
    const absl::StatusOr<TriangleMesh> all = PlaceMeshes(job_, list);
    if (!all.ok()) return all.status();
    return Voxelize(*all, request, {job_});
  }

  void ExpectAsHere(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request) {
    const auto expected = Local(meshes, request);
    ASSERT_TRUE(expected.ok()) << expected.status();
    const auto result = client_->VoxelizePlaced(meshes, request, job_);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(result->result.grid, expected->grid);
    EXPECT_TRUE(Bytes(result->result) == Bytes(*expected));
    EXPECT_EQ(result->stats.occupied, expected->stats.occupied);
    EXPECT_EQ(result->stats.odd_columns, expected->stats.odd_columns);
    EXPECT_EQ(result->report.triangles, expected->stats.triangles);
  }

  std::string HashOfPlaced(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request = SmallRequest()) {
    const auto result = client_->VoxelizePlaced(meshes, request, job_);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? result->content_sha256 : "";
  }

  // The answers of all calls that take a mesh.
  std::vector<std::pair<std::string, grpc::Status>> StatusesOf(const v1::VoxelizeRequest& request) {
    std::vector<std::pair<std::string, grpc::Status>> all;
    all.emplace_back("Voxelize", Call(*stub_, request).status);
    all.emplace_back("VoxelizeUpload", CallUpload(*stub_, {UploadOf(request)}).status);
    const auto with_context = [&](const std::string& name, const auto& call) {
      grpc::ClientContext context;
      context.set_deadline(std::chrono::system_clock::now() + kPatience);
      all.emplace_back(name, call(context));
    };
    with_context("EstimateVoxelization", [&](grpc::ClientContext& context) {
      v1::EstimateVoxelizationRequest message;
      *message.mutable_mesh() = request.mesh();
      *message.mutable_spec() = request.spec();
      v1::EstimateVoxelizationResponse response;
      return stub_->EstimateVoxelization(&context, message, &response);
    });
    with_context("ExportFile", [&](grpc::ClientContext& context) {
      v1::ExportFileRequest message;
      *message.mutable_request() = request;
      message.set_format("npy");
      const auto stream = stub_->ExportFile(&context, message);
      v1::FileChunk chunk;
      while (stream->Read(&chunk)) {}
      return stream->Finish();
    });
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->VoxelizeBatch(&context);
    v1::VoxelizeBatchRequest message;
    *message.add_jobs() = JobOf(1, request);
    EXPECT_TRUE(stream->Write(message));
    stream->WritesDone();
    std::map<uint64_t, Received> jobs;
    for (v1::VoxelizeBatchResponse response; stream->Read(&response);) Add(response, jobs);
    EXPECT_TRUE(stream->Finish().ok());
    all.emplace_back("VoxelizeBatch", jobs[1].status);
    return all;
  }

  const std::vector<uint8_t> slab_glb_ = TorusGlb(5);
  std::string torus_, slab_;
};

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

std::vector<std::string> NamesIn(const grpc::Status& status) {
  google::rpc::Status all;
  EXPECT_TRUE(all.ParseFromString(status.error_details()));
  std::vector<std::string> names;
  google::rpc::ResourceInfo missing;
  for (const auto& detail : all.details()) {
    if (!detail.UnpackTo(&missing)) continue;
    EXPECT_EQ(missing.resource_type(), "voxelpipe.v1.Mesh");
    names.push_back(missing.resource_name());
  }
  return names;
}

std::string Missing(int number) {
  const std::string digits = std::to_string(number);
  return "meshes/" + std::string(64 - digits.size(), 'a') + digits;
}

TEST_F(PlacedMeshesTest, AllThatAreMissingAreNamedAtOnce) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  const v1::VoxelizeRequest request = PlacedRequestOf(
      SmallRequest(), {{Missing(1)}, {torus_}, {Missing(2)}, {Missing(1), Moved(1, 0, 0)}, {Missing(3) + "-mm-stl"}});
  const std::vector<std::string> expected{Missing(1), Missing(2), Missing(3) + "-mm-stl"};
  for (const auto& [call, status] : StatusesOf(request)) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND) << call;
    EXPECT_EQ(ReasonOf(status), "MESH_NOT_FOUND") << call;
    EXPECT_EQ(NamesIn(status), expected) << call;
    EXPECT_NE(status.error_message().find("3 meshes"), std::string::npos) << call << ": " << status.error_message();
    EXPECT_EQ(MissingMeshes(FromGrpcStatus(status)), expected) << call;
  }
}

// Trailers hold a part of the names, replies of a batch a hundred.
TEST_F(PlacedMeshesTest, OfManyMissingMeshesSomeAreNamedAndAllCounted) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  std::vector<PlacedStored> list;
  for (int i = 0; i < 1234; ++i) list.push_back({Missing(i)});
  for (const auto& [call, status] : StatusesOf(PlacedRequestOf(SmallRequest(), list))) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND) << call << ": " << status.error_message();
    EXPECT_NE(status.error_message().find("1234 meshes"), std::string::npos) << call << ": " << status.error_message();
    const std::vector<std::string> names = NamesIn(status);
    EXPECT_EQ(names.size(), call == "VoxelizeBatch" ? 100u : std::min<size_t>(names.size(), 100)) << call;
    EXPECT_GE(names.size(), 25u) << call;
    for (size_t i = 0; i < names.size(); ++i) EXPECT_EQ(names[i], Missing(int(i))) << call;
  }
}

TEST_F(PlacedMeshesTest, WhatIsWrongIsNamed) {
  ASSERT_NO_FATAL_FAILURE(StartWithMeshes());
  using Change = std::function<void(v1::PlacedMesh&)>;
  const auto with_matrix = [](int at, double number) -> Change {
    return [=](v1::PlacedMesh& mesh) {
      for (const double n : {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}) mesh.add_matrix(n);
      mesh.set_matrix(at, number);
    };
  };
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
  const std::vector<std::pair<std::string, Change>> cases{
      {"mesh.placed.meshes[1].matrix[5]", with_matrix(5, nan)},
      {"mesh.placed.meshes[1].matrix[3]", with_matrix(3, -infinite)},
      {"mesh.placed.meshes[1].matrix", with_matrix(12, 1)},
      {"mesh.placed.meshes[1].matrix", with_matrix(15, 2)},
      {"mesh.placed.meshes[1].matrix", with_matrix(0, 0)},
      {"mesh.placed.meshes[1].matrix", [](v1::PlacedMesh& mesh) { mesh.add_matrix(1); }},
      {"mesh.placed.meshes[1].label", [](v1::PlacedMesh& mesh) { mesh.set_label(0); }},
      {"mesh.placed.meshes[1].mesh", [](v1::PlacedMesh& mesh) { mesh.clear_mesh(); }},
      {"mesh.placed.meshes[1].mesh", [](v1::PlacedMesh& mesh) { mesh.set_mesh("meshes/../etc/passwd"); }},
      {"mesh.placed.meshes[1].motion.angular.y",
       [&](v1::PlacedMesh& mesh) { mesh.mutable_motion()->mutable_angular()->set_y(nan); }},
  };
  for (const auto& [field, change] : cases) {
    v1::VoxelizeRequest request = PlacedRequestOf(SmallRequest(), {{torus_}, {slab_}});
    change(*request.mutable_mesh()->mutable_placed()->mutable_meshes(1));
    for (const auto& [call, status] : StatusesOf(request)) {
      EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << call << " " << field;
      EXPECT_EQ(FieldOf(status), field) << call << ": " << status.error_message();
    }
  }
  v1::VoxelizeRequest none;
  none.mutable_mesh()->mutable_placed();
  for (const auto& [call, status] : StatusesOf(none)) EXPECT_EQ(FieldOf(status), "mesh.placed.meshes") << call;
}

// With all that an entry may have, and one more than is possible.
TEST_F(PlacedMeshesTest, SixtyFiveThousandAreTheMost) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(TorusGlb(1)).name;
  std::vector<PlacedStored> list;
  for (size_t i = 0; i < kMaxPlacedMeshes; ++i) {
    const double x = double(i % 256), y = double(i / 256);
    list.push_back({name, Moved(4 * x, 4 * y, 0), "part number " + std::to_string(i), uint32_t(i + 70'000), -1,
                    RigidMotionNumbers{{x, y, 1}, {x, 1, y}, {1, x, y}}});
  }
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 256;
  const auto all = client_->VoxelizePlaced(list, request, job_);
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_EQ(all->report.triangles, 2 * kMaxPlacedMeshes);
  list.push_back({name});
  for (const auto& [call, status] : StatusesOf(PlacedRequestOf(request, list))) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << call << ": " << status.error_message();
    EXPECT_EQ(FieldOf(status), "mesh.placed.meshes") << call;
    EXPECT_NE(status.error_message().find("65536"), std::string::npos) << call << ": " << status.error_message();
  }
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
