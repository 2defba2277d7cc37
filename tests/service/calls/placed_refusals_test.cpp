// Requests for several placed meshes that are refused: what is missing or wrong is named.
#include <algorithm>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "google/rpc/error_details.pb.h"
#include "gtest/gtest.h"
#include "service/calls/placed_fixture.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

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

}  // namespace
}  // namespace voxelpipe::testing
