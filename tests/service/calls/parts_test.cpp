// Parts of a mesh: their labels, and meshes without some of them.
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/load_mesh.h"
#include "many_stream.h"
#include "mesh/parts/part_list.h"
#include "mesh/placed_mesh.h"
#include "pipeline/voxelize.h"
#include "service/support/mesh_store_fixture.h"
#include "support/meshes/glb_builder.h"
#include "wire/placed.h"
#include "wire/request.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

// Cubes side by side, each a node with a mesh and a name: "box 0", ...
std::vector<uint8_t> BoxesGlb(int count) {
  GlbBuilder glb;
  const Shape cube = CubeShape();
  std::vector<int> roots;
  for (int i = 0; i < count; ++i) {
    const std::string name = "box " + std::to_string(i);
    const int mesh = glb.Mesh(glb.Primitive(cube.positions, cube.indices));
    roots.push_back(glb.Node({{"mesh", mesh}, {"name", name}, {"translation", {1.5 * i, 0, 0}}}));
  }
  glb.Scene(roots);
  return glb.Glb();
}

VoxelizeRequest LabelRequest() {
  VoxelizeRequest request;
  request.grid.resolution = 24;
  request.parts.scope = PartScope::kNode;
  request.targets[0].format = VoxelFormat::kU16;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"label", {}};
  return request;
}

VoxelizeRequest Without(const std::string& pattern) {
  VoxelizeRequest request = LabelRequest();
  request.parts.exclude = {pattern};
  return request;
}

std::string Bytes(const VoxelizeResult& result) {
  std::string all;
  for (const auto array : ArraysOf(result)) all.append(array.begin(), array.end());
  return all;
}

class PartsTest : public MeshStoreTest {
 protected:
  // The mesh in this process, as the command line makes it.
  TriangleMesh Local(const std::vector<PlacedStored>& placed, const VoxelizeRequest& request) {
    absl::StatusOr<LoadedMesh> file = LoadMeshFor(job_, boxes_, {});
    EXPECT_TRUE(file.ok()) << file.status();
    const auto mesh = std::make_shared<TriangleMesh>(std::move(file->mesh));
    std::vector<PlacedMesh> list;
    for (const PlacedStored& one : placed) {
      list.push_back({mesh, one.matrix, one.name, one.label, one.priority, one.motion});
    }
    absl::StatusOr<TriangleMesh> all = placed.empty() ? *mesh : PlaceMeshes(job_, list);
    EXPECT_TRUE(all.ok()) << all.status();
    if (request.parts.exclude.empty()) return *std::move(all);
    absl::StatusOr<TriangleMesh> kept = ExcludeParts(job_, *all, request.parts);
    EXPECT_TRUE(kept.ok()) << kept.status();
    return *std::move(kept);
  }

  void ExpectAsHere(const absl::StatusOr<RemoteResult>& result, const VoxelizeRequest& request,
                    const std::vector<PlacedStored>& placed = {}) {
    const TriangleMesh mesh = Local(placed, request);
    const auto expected = Voxelize(mesh, request, {job_});
    ASSERT_TRUE(expected.ok()) << expected.status();
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(result->result.grid, expected->grid);
    EXPECT_TRUE(Bytes(result->result) == Bytes(*expected));
    EXPECT_EQ(result->stats.occupied, expected->stats.occupied);
    EXPECT_EQ(result->stats.warnings.kept(), expected->stats.warnings.kept());
    EXPECT_EQ(result->report.triangles, mesh.triangles.size());
    EXPECT_EQ(result->report.open_edges, 0u);
  }

  // As a file, stored, and placed.
  void ExpectAsHereEverywhere(const VoxelizeRequest& request) {
    const std::string name = Upload(boxes_).name;
    ExpectAsHere(client_->Voxelize(boxes_, MeshFormat::kAuto, request, job_), request);
    ExpectAsHere(client_->VoxelizeStored(name, request, job_), request);
    Mat4d behind;
    behind.m[2][3] = 2;
    const std::vector<PlacedStored> placed{{name, Mat4d(), "front"}, {name, behind, "back"}};
    ExpectAsHere(client_->VoxelizePlaced(placed, request, job_), request, placed);
  }

  const std::vector<uint8_t> boxes_ = BoxesGlb(3);
};

TEST_F(PartsTest, LabelsAreThoseOfTheCore) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ExpectAsHereEverywhere(LabelRequest());
  VoxelizeRequest request = LabelRequest();
  request.parts.labels = {{"*", 500}, {"box 1", 40'000}};
  request.parts.priorities = {{"box 2", -5}};
  ExpectAsHereEverywhere(request);
  request.parts.scope = PartScope::kFile;
  request.parts.labels = {{"back", 9}};
  request.parts.priorities = {};
  const std::string name = Upload(boxes_).name;
  const std::vector<PlacedStored> placed{{name, Mat4d(), "front", 70u}, {name, Mat4d(), "back"}};
  ExpectAsHere(client_->VoxelizePlaced(placed, request, job_), request, placed);
}

TEST_F(PartsTest, ExcludedPartsAreNotInTheMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ExpectAsHereEverywhere(Without("box 0"));
  ExpectAsHereEverywhere(Without("*"));
  VoxelizeRequest mesh = Without("*");
  mesh.parts.scope = PartScope::kMaterial;
  mesh.parts.exclude = {"glass"};  // there is none
  ExpectAsHereEverywhere(mesh);
}

// The facts about the mesh are of what is left.
TEST_F(PartsTest, EstimatesAreOfWhatIsLeft) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(boxes_).name;
  const auto result = client_->VoxelizeStored(name, Without("box 2"), job_);
  ASSERT_TRUE(result.ok()) << result.status();
  for (const auto& estimate : {client_->EstimateStored(name, Without("box 2"), job_),
                               client_->Estimate(boxes_, MeshFormat::kAuto, Without("box 2"), job_)}) {
    ASSERT_TRUE(estimate.ok()) << estimate.status();
    EXPECT_EQ(estimate->plan.grid, result->result.grid);
    EXPECT_EQ(estimate->report.triangles, 24u);
    EXPECT_EQ(estimate->report.max.x, 2.5);
  }
  grpc::ClientContext context;
  v1::EstimateVoxelizationRequest message;
  message.mutable_mesh()->mutable_stored()->set_name(name);
  *message.mutable_spec() = MakeSpec(Without("box [12]"));  // brackets are themselves
  v1::EstimateVoxelizationResponse response;
  const grpc::Status status = stub_->EstimateVoxelization(&context, message, &response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(response.warnings_size(), 1);
  EXPECT_EQ(response.warnings(0).code(), v1::WARNING_CODE_PART_NOT_FOUND);
  const auto none = client_->EstimateStored(name, Without("box ?"), job_);
  ASSERT_TRUE(none.ok()) << none.status();
  EXPECT_EQ(none->report.triangles, 0u);
}

TEST_F(PartsTest, FilesAndBatchesAreOfWhatIsLeft) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(boxes_).name;
  const auto exported = [&](const VoxelizeRequest& request, const std::string& mesh) {
    v1::ExportFileRequest message;
    *message.mutable_request() = StoredRequestOf(request, mesh);
    message.set_format("npy");
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->ExportFile(&context, message);
    std::string file;
    for (v1::FileChunk chunk; stream->Read(&chunk);) file += chunk.data();
    const grpc::Status status = stream->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
    return file;
  };
  const std::string two = Upload(BoxesGlb(2)).name;
  EXPECT_TRUE(exported(Without("box 2"), name) == exported(LabelRequest(), two));
  EXPECT_FALSE(exported(Without("box 2"), name) == exported(LabelRequest(), name));

  const auto stream = client_->OpenMany(job_);
  ASSERT_TRUE(stream->SendStored(0, name, Without("box 2")).ok());
  ASSERT_TRUE(stream->Send(1, boxes_, MeshFormat::kAuto, Without("box 2")).ok());
  ASSERT_TRUE(stream->SendStored(2, two, LabelRequest()).ok());
  stream->FinishSending();
  for (int i = 0; i < 3; ++i) {
    const absl::StatusOr<ManyAnswer> answer = stream->Receive();
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_TRUE(answer->result.ok()) << answer->result.status();
    EXPECT_EQ(answer->result->content_sha256, HashOfStored(two, LabelRequest())) << answer->id;
  }
}

TEST_F(PartsTest, NewPositionsAreOfAllVertices) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(boxes_).name;
  std::vector<float> positions;
  const TriangleMesh all = Local({}, LabelRequest());
  for (const Vec3d& p : all.positions) {
    for (int a = 0; a < 3; ++a) positions.push_back(float(p[a]) * (a == 1 ? 2 : 1));
  }
  const auto result = client_->VoxelizeStored(name, Without("box 1"), job_, positions);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->report.triangles, 24u);
  EXPECT_EQ(result->report.max.y, 2);
  EXPECT_NE(result->content_sha256, HashOfStored(name, Without("box 1")));
}

TEST_F(PartsTest, APatternWithoutAPartIsAWarningOrWithStrictAnError) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = Without("sphere");
  const auto result = client_->Voxelize(boxes_, MeshFormat::kAuto, request, job_);
  ASSERT_TRUE(result.ok()) << result.status();
  ASSERT_EQ(result->stats.warnings.kept().size(), 1u);
  EXPECT_EQ(result->stats.warnings.kept()[0].code, WarningCode::kPartNotFound);
  EXPECT_EQ(result->stats.warnings.kept()[0].text, "no part is called 'sphere'; there are 'box 0', 'box 1', 'box 2'");
  request.strict = true;
  const auto strict = client_->Voxelize(boxes_, MeshFormat::kAuto, request, job_);
  EXPECT_TRUE(absl::IsInvalidArgument(strict.status())) << strict.status();
  EXPECT_THAT(std::string(strict.status().message()), HasSubstr("no part is called 'sphere'"));
}

TEST_F(PartsTest, PartsAreOfTheIdentityOfAResult) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16777216"}));
  const std::string name = Upload(boxes_).name;
  std::vector<VoxelizeRequest> requests{LabelRequest(), Without("box 0"), Without("box 1"), LabelRequest()};
  requests.back().parts.labels = {{"box 2", 77}};
  std::vector<std::string> hashes;
  for (const VoxelizeRequest& request : requests) hashes.push_back(HashOfStored(name, request));
  for (size_t i = 0; i < requests.size(); ++i) {
    for (size_t j = 0; j < i; ++j) EXPECT_NE(hashes[i], hashes[j]);
    EXPECT_EQ(HashOfStored(name, requests[i]), hashes[i]) << "cached";
  }
}

TEST_F(PartsTest, TheResolvedSpecGivesTheSameBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeRequest message = MakeRequest(Without("box 1"));
  message.mutable_spec()->mutable_parts()->add_labels()->set_number(7);
  message.mutable_spec()->mutable_parts()->mutable_labels(0)->set_pattern("box 2");
  SetFile(message, boxes_);
  const Received first = Call(*stub_, message);
  ASSERT_TRUE(first.status.ok()) << first.status.error_message();
  EXPECT_EQ(first.header.spec().parts().SerializeAsString(), message.spec().parts().SerializeAsString());
  *message.mutable_spec() = first.header.spec();
  EXPECT_TRUE(Call(*stub_, message).bytes == first.bytes);
}

TEST_F(PartsTest, WhatIsWrongIsNamed) {
  ASSERT_NO_FATAL_FAILURE(Start());
  using Change = std::function<void(v1::PartSelection&)>;
  const auto label = [](v1::PartSelection& parts, int64_t number) {
    v1::PartRule& rule = *parts.add_labels();
    rule.set_pattern("*");
    rule.set_number(number);
  };
  const std::vector<std::pair<std::string, Change>> cases{
      {"parts.labels[2].number",
       [&](v1::PartSelection& parts) {
         label(parts, 1);
         label(parts, 4'294'967'295);
         label(parts, 0);
       }},
      {"parts.labels[0].number", [&](v1::PartSelection& parts) { label(parts, 4'294'967'296); }},
      {"parts.priorities[0].number",
       [](v1::PartSelection& parts) { parts.add_priorities()->set_number(2'147'483'648); }},
      {"parts.scope", [](v1::PartSelection& parts) { parts.set_scope(v1::PartScope(17)); }},
      {"parts.exclude",
       [](v1::PartSelection& parts) {
         parts.set_scope(v1::PART_SCOPE_WHOLE);
         parts.add_exclude("a");
       }},
      {"parts.exclude",
       [](v1::PartSelection& parts) {
         for (int i = 0; i < 1001; ++i) parts.add_exclude("a");
       }},
      {"targets[0].format", [&](v1::PartSelection& parts) { label(parts, 65'536); }},
  };
  for (const auto& [field, change] : cases) {
    v1::VoxelizeRequest message = MakeRequest(LabelRequest());
    change(*message.mutable_spec()->mutable_parts());
    SetFile(message, boxes_);
    const grpc::Status status = Call(*stub_, message).status;
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << field;
    EXPECT_EQ(FieldOf(status), field) << status.error_message();
  }
}

// 1 MiB of messages hold 1000 rules with names; their parts are bounded too.
TEST_F(PartsTest, ManyRulesAreTaken) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = LabelRequest();
  for (int i = 0; i < 1000; ++i) {
    request.parts.labels.push_back({"b*" + std::string(100, 'x'), 5});
    request.parts.exclude.push_back("box 1");
  }
  request.parts.labels.back().pattern = "box 2";
  const auto result = client_->Voxelize(boxes_, MeshFormat::kAuto, request, job_);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->report.triangles, 24u);
}

}  // namespace
}  // namespace voxelpipe::testing
