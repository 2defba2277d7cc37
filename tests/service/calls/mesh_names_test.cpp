// The names of stored meshes, and the calls that make and list them.
#include <chrono>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/checksum/crc32c.h"
#include "gmock/gmock.h"
#include "google/rpc/error_details.pb.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/mesh_name.h"
#include "wire/request.h"

namespace voxelpipe::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::EndsWith;

// A tetrahedron with edges of 1000, in a format without a unit.
std::vector<uint8_t> Obj() {
  constexpr std::string_view kText =
      "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nv 0 0 1000\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n";
  return {kText.begin(), kText.end()};
}

class MeshNamesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "warn"});
    ASSERT_NE(server_, nullptr);
    stub_ = StubOf(*server_);
  }

  static void SetDeadline(grpc::ClientContext& context) {
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
  }
  grpc::Status Create(const std::vector<uint8_t>& file, const MeshFileType& type, v1::Mesh& mesh) {
    v1::CreateMeshRequest request;
    WriteTo(type, *request.mutable_mesh());
    request.mutable_mesh()->set_data(file.data(), file.size());
    return Create(request, mesh);
  }
  grpc::Status Create(const v1::CreateMeshRequest& request, v1::Mesh& mesh) {
    grpc::ClientContext context;
    SetDeadline(context);
    mesh.Clear();
    return stub_->CreateMesh(&context, request, &mesh);
  }
  // The bytes follow unless they are empty.
  grpc::Status Upload(const std::vector<uint8_t>& file, const v1::MeshUpload& upload, v1::Mesh& mesh) {
    grpc::ClientContext context;
    SetDeadline(context);
    mesh.Clear();
    const auto stream = stub_->UploadMesh(&context, &mesh);
    v1::UploadMeshRequest message;
    *message.mutable_upload() = upload;
    stream->Write(message);
    message.set_piece(file.data(), file.size());
    if (!file.empty()) stream->Write(message);
    stream->WritesDone();
    return stream->Finish();
  }
  grpc::Status Upload(const std::vector<uint8_t>& file, const MeshFileType& type, const std::string& expected_id,
                      v1::Mesh& mesh) {
    v1::MeshUpload upload;
    upload.set_format(ToMessage(type.format));
    upload.set_unit(ToMessage(type.unit));
    upload.set_expected_id(expected_id);
    return Upload(file, upload, mesh);
  }
  grpc::Status Get(const std::string& name, v1::Mesh& mesh) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::GetMeshRequest request;
    request.set_name(name);
    return stub_->GetMesh(&context, request, &mesh);
  }
  grpc::Status List(int32_t page_size, const std::string& token, v1::ListMeshesResponse& page) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::ListMeshesRequest request;
    request.set_page_size(page_size);
    request.set_page_token(token);
    return stub_->ListMeshes(&context, request, &page);
  }
  static std::vector<std::string> Names(const v1::ListMeshesResponse& page) {
    std::vector<std::string> names;
    for (const v1::Mesh& mesh : page.meshes()) names.push_back(mesh.name());
    return names;
  }
  // All pages, of so many meshes each.
  std::vector<std::string> ListAll(int32_t page_size) {
    std::vector<std::string> names;
    std::string token;
    do {
      v1::ListMeshesResponse page;
      const grpc::Status status = List(page_size, token, page);
      EXPECT_TRUE(status.ok()) << status.error_message();
      EXPECT_LE(page.meshes_size(), page_size);
      for (const std::string& name : Names(page)) names.push_back(name);
      token = page.next_page_token();
    } while (!token.empty());
    return names;
  }
  grpc::Status Release(const std::string& name) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::ReleaseMeshRequest request;
    request.set_name(name);
    v1::ReleaseMeshResponse response;
    return stub_->ReleaseMesh(&context, request, &response);
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

TEST_F(MeshNamesTest, OneMessageMakesWhatAnUploadMakes) {
  const std::vector<uint8_t> glb = TorusGlb(8);
  v1::Mesh created, uploaded;
  grpc::Status status = Create(glb, {}, created);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(created.name(), MeshNameOf(glb, {}));
  EXPECT_EQ(created.format(), v1::MESH_FORMAT_GLB);
  EXPECT_EQ(created.unit(), v1::LENGTH_UNIT_UNSPECIFIED);
  EXPECT_EQ(created.file_bytes(), int64_t(glb.size()));
  EXPECT_GT(created.memory_bytes(), 0);
  EXPECT_EQ(created.report().triangles(), 128);
  EXPECT_EQ(created.uses(), 0);
  EXPECT_FALSE(created.already_stored());
  status = Upload(glb, {}, "", uploaded);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(uploaded.already_stored());
  uploaded.set_already_stored(false);
  EXPECT_EQ(uploaded.SerializeAsString(), created.SerializeAsString());
  ASSERT_TRUE(Create(glb, {}, created).ok());
  EXPECT_TRUE(created.already_stored());
  // And it serves.
  const VoxelizeRequest request = SmallRequest();
  const Received stored = Call(*stub_, StoredRequestOf(request, created.name()));
  EXPECT_TRUE(stored.status.ok()) << stored.status.error_message();
  EXPECT_EQ(stored.bytes, Call(*stub_, RequestOf(request, glb)).bytes);
}

TEST_F(MeshNamesTest, WhatIsNoMeshIsRefusedByField) {
  v1::CreateMeshRequest request;
  v1::Mesh mesh;
  const auto expect = [&](grpc::StatusCode code, const std::string& begin) {
    const grpc::Status status = Create(request, mesh);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_TRUE(status.error_message().starts_with(begin)) << status.error_message();
  };
  expect(grpc::StatusCode::INVALID_ARGUMENT, "");
  request.mutable_mesh()->set_data("no mesh at all");
  expect(grpc::StatusCode::INVALID_ARGUMENT, "");
  request.mutable_mesh()->set_format(v1::MeshFormat(99));
  expect(grpc::StatusCode::INVALID_ARGUMENT, "mesh.format: ");
  request.mutable_mesh()->clear_format();
  request.mutable_mesh()->set_unit(v1::LengthUnit(99));
  expect(grpc::StatusCode::INVALID_ARGUMENT, "mesh.unit: ");
  const std::vector<uint8_t> obj = Obj();
  request.mutable_mesh()->clear_unit();
  request.mutable_mesh()->set_data(obj.data(), obj.size());
  request.mutable_mesh()->set_crc32c(Crc32c(obj) ^ 1);
  expect(grpc::StatusCode::DATA_LOSS, "");
  request.mutable_mesh()->set_crc32c(Crc32c(obj));
  expect(grpc::StatusCode::OK, "");
  EXPECT_EQ(mesh.name(), MeshNameOf(obj, {}));

  v1::MeshUpload upload;
  const auto expect_upload = [&](const std::string& begin) {
    const grpc::Status status = Upload(obj, upload, mesh);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
    EXPECT_TRUE(status.error_message().starts_with(begin)) << status.error_message();
  };
  upload.set_format(v1::MeshFormat(99));
  expect_upload("upload.format: ");
  upload.clear_format();
  upload.set_unit(v1::LengthUnit(99));
  expect_upload("upload.unit: ");
  upload.clear_unit();
  upload.set_expected_id("no name");
  expect_upload("upload.expected_id: ");
}

TEST_F(MeshNamesTest, TheSameBytesInAnotherFormatOrUnitAreAnotherMesh) {
  const std::vector<uint8_t> obj = Obj();
  const std::string plain = MeshNameOf(obj, {});
  struct Case {
    MeshFileType type;
    std::string suffix;
    double size;
  };
  const std::vector<Case> cases = {{{}, "", 1000},
                                   {{MeshFormat::kAuto, LengthUnit::kMillimetre}, "-mm", 1},
                                   {{MeshFormat::kAuto, LengthUnit::kCentimetre}, "-cm", 10},
                                   {{MeshFormat::kAuto, LengthUnit::kMetre}, "-m", 1000},
                                   {{MeshFormat::kAuto, LengthUnit::kInch}, "-in", 25.4},
                                   {{MeshFormat::kObj, LengthUnit::kNone}, "-obj", 1000},
                                   {{MeshFormat::kObj, LengthUnit::kMillimetre}, "-mm-obj", 1}};
  std::vector<std::string> names;
  v1::Mesh mesh;
  for (const auto& [type, suffix, size] : cases) {
    const grpc::Status status = names.size() % 2 == 0 ? Create(obj, type, mesh) : Upload(obj, type, "", mesh);
    ASSERT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(mesh.name(), plain + suffix);
    EXPECT_FALSE(mesh.already_stored()) << mesh.name();
    EXPECT_EQ(mesh.format(), v1::MESH_FORMAT_OBJ);
    EXPECT_EQ(mesh.unit(), ToMessage(type.unit));
    EXPECT_NEAR(mesh.report().max().x(), size, 1e-9) << mesh.name();
    names.insert(names.begin(), mesh.name());
  }
  EXPECT_THAT(ListAll(100), ElementsAreArray(names)) << "each is there by its own name";
  for (size_t i = 0; i < cases.size(); ++i) {
    const std::string& name = names[names.size() - 1 - i];
    ASSERT_TRUE(Get(name, mesh).ok());
    EXPECT_NEAR(mesh.report().max().x(), cases[i].size, 1e-9) << name;
    // A job by its name is a job with the file in that unit.
    const Received stored = Call(*stub_, StoredRequestOf(SmallRequest(), name)),
                   sent = Call(*stub_, RequestOf(SmallRequest(), obj, cases[i].type));
    ASSERT_TRUE(stored.status.ok() && sent.status.ok());
    EXPECT_EQ(stored.header.SerializeAsString(), sent.header.SerializeAsString()) << name;
    EXPECT_EQ(stored.bytes, sent.bytes) << name;
    // One goes without the others.
    EXPECT_TRUE(Release(name).ok());
    EXPECT_EQ(Get(name, mesh).error_code(), grpc::StatusCode::NOT_FOUND);
  }
}

// The format that is given is looked at, although the bytes are stored without one.
TEST_F(MeshNamesTest, AWrongFormatFailsThoughTheBytesAreStored) {
  const std::vector<uint8_t> glb = TorusGlb(8);
  v1::Mesh mesh;
  ASSERT_TRUE(Create(glb, {}, mesh).ok());
  for (const MeshFormat wrong : {MeshFormat::kStl, MeshFormat::kObj, MeshFormat::kGltf, MeshFormat::kDraco}) {
    v1::Mesh other;
    EXPECT_EQ(Create(glb, wrong, other).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << Name(wrong);
    EXPECT_EQ(Upload(glb, wrong, "", other).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << Name(wrong);
    EXPECT_EQ(Call(*stub_, RequestOf(SmallRequest(), glb, wrong)).status.error_code(),
              grpc::StatusCode::INVALID_ARGUMENT);
  }
  v1::Mesh other;
  EXPECT_EQ(Create(glb, {MeshFormat::kAuto, LengthUnit::kInch}, other).error_code(), grpc::StatusCode::INVALID_ARGUMENT)
      << "the format has a unit";
  EXPECT_THAT(ListAll(10), ElementsAre(mesh.name()));
}

// The name holds the format and the unit: with others the bytes have another name.
TEST_F(MeshNamesTest, AnExpectedNameIsThatOfTheBytesAndTheirType) {
  const std::vector<uint8_t> obj = Obj();
  const MeshFileType inches{MeshFormat::kObj, LengthUnit::kInch};
  v1::Mesh mesh;
  EXPECT_EQ(Upload(obj, inches, MeshNameOf(obj, {}), mesh).error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(Upload(obj, {}, MeshNameOf(obj, inches), mesh).error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_TRUE(ListAll(10).empty()) << "nothing of it was kept";
  ASSERT_TRUE(Upload(obj, inches, MeshNameOf(obj, inches), mesh).ok());
  EXPECT_THAT(mesh.name(), EndsWith("-in-obj"));
  // Now the name alone is enough, and only this one.
  ASSERT_TRUE(Upload({}, inches, MeshNameOf(obj, inches), mesh).ok());
  EXPECT_TRUE(mesh.already_stored());
  EXPECT_FALSE(Upload({}, {}, MeshNameOf(obj, {}), mesh).ok());
}

TEST_F(MeshNamesTest, AListHasPagesTheNewestFirst) {
  EXPECT_TRUE(ListAll(7).empty());
  std::vector<std::string> names;
  for (int side = 4; side < 14; ++side) {
    v1::Mesh mesh;
    ASSERT_TRUE(Create(TorusGlb(side), {}, mesh).ok());
    names.insert(names.begin(), mesh.name());
  }
  for (const int32_t page_size : {1, 3, 5, 10, 11, 1000}) EXPECT_THAT(ListAll(page_size), ElementsAreArray(names));
  v1::ListMeshesResponse page;
  ASSERT_TRUE(List(0, "", page).ok());
  EXPECT_THAT(Names(page), ElementsAreArray(names)) << "0 is the server's choice";
  EXPECT_EQ(page.next_page_token(), "");
  ASSERT_TRUE(List(std::numeric_limits<int32_t>::max(), "", page).ok());
  EXPECT_EQ(page.meshes_size(), 10);
  // A use changes nothing, nor does a mesh that comes again; what is new or gone meanwhile does not disturb a list.
  EXPECT_TRUE(Call(*stub_, StoredRequestOf(SmallRequest(), names[7])).status.ok());
  v1::Mesh mesh;
  ASSERT_TRUE(Create(TorusGlb(4), {}, mesh).ok());
  EXPECT_TRUE(mesh.already_stored());
  ASSERT_TRUE(List(4, "", page).ok());
  EXPECT_THAT(Names(page), ElementsAreArray(names.begin(), names.begin() + 4));
  ASSERT_TRUE(Create(TorusGlb(20), {}, mesh).ok());
  ASSERT_TRUE(Release(names[3]).ok());
  ASSERT_TRUE(Release(names[5]).ok());
  const std::string token = page.next_page_token();
  ASSERT_TRUE(List(4, token, page).ok());
  EXPECT_THAT(Names(page), ElementsAre(names[4], names[6], names[7], names[8]));
  EXPECT_EQ(page.meshes(2).uses(), 1);
  EXPECT_EQ(page.meshes(0).report().triangles(), 2 * 9 * 9);
}

TEST_F(MeshNamesTest, APageThatCannotBeIsRefusedByField) {
  v1::ListMeshesResponse page;
  EXPECT_TRUE(List(-1, "", page).error_message().starts_with("page_size: "));
  EXPECT_EQ(List(-1, "", page).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  for (const char* token : {"no token", "-1", "1 ", "99999999999999999999999"}) {
    const grpc::Status status = List(0, token, page);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << token;
    EXPECT_TRUE(status.error_message().starts_with("page_token: ")) << status.error_message();
  }
}

TEST_F(MeshNamesTest, AMissingMeshIsNamedByEveryCall) {
  const std::string name = "meshes/" + std::string(64, 'b') + "-mm-stl";
  const auto expect_named = [&](const grpc::Status& status, const char* call) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND) << call << ": " << status.error_message();
    EXPECT_EQ(ReasonOf(status), "MESH_NOT_FOUND") << call;
    const auto missing = DetailOf<google::rpc::ResourceInfo>(status);
    EXPECT_EQ(missing.resource_name(), name) << call;
    EXPECT_EQ(missing.resource_type(), "voxelpipe.v1.Mesh") << call;
  };
  v1::Mesh mesh;
  expect_named(Get(name, mesh), "GetMesh");
  expect_named(Release(name), "ReleaseMesh");
  const v1::VoxelizeRequest request = StoredRequestOf(SmallRequest(), name);
  expect_named(Call(*stub_, request).status, "Voxelize");
  expect_named(CallUpload(*stub_, request).status, "VoxelizeUpload");
  {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::DeleteMeshRequest message;
    message.set_name(name);
    v1::DeleteMeshResponse response;
    expect_named(stub_->DeleteMesh(&context, message, &response), "DeleteMesh");
  }
  {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::EstimateVoxelizationRequest message;
    *message.mutable_mesh() = request.mesh();
    v1::EstimateVoxelizationResponse response;
    expect_named(stub_->EstimateVoxelization(&context, message, &response), "EstimateVoxelization");
  }
  grpc::ClientContext context;
  SetDeadline(context);
  const auto stream = stub_->VoxelizeBatch(&context);
  v1::VoxelizeBatchRequest message;
  *message.add_jobs() = JobOf(1, request);
  ASSERT_TRUE(stream->Write(message));
  stream->WritesDone();
  std::map<uint64_t, Received> jobs;
  for (v1::VoxelizeBatchResponse response; stream->Read(&response);) Add(response, jobs);
  EXPECT_TRUE(stream->Finish().ok());
  expect_named(jobs[1].status, "VoxelizeBatch");
}

}  // namespace
}  // namespace voxelpipe::testing
