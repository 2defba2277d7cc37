// What the client sends, and what it makes of the replies that no other test here concerns.
#include "client.h"

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "gmock/gmock.h"
#include "grid/grid_spec.h"
#include "gtest/gtest.h"
#include "many_stream.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/contract_revision.h"
#include "wire/mesh_name.h"

namespace voxelpipe::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// A service at a port of its own. The base class knows no call.
class Serving {
 public:
  explicit Serving(grpc::Service& service) {
    builder_.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder_.RegisterService(&service);
    server_ = builder_.BuildAndStart();
  }
  std::string target() const { return absl::StrCat("127.0.0.1:", port_); }
  std::unique_ptr<Client> Connect() const { return *Client::Connect(target()); }

 private:
  int port_ = 0;
  grpc::ServerBuilder builder_;
  std::unique_ptr<grpc::Server> server_;
};

// Keeps what it receives, and refuses jobs for good.
class KeepingService final : public v1::VoxelizationService::Service {
 public:
  grpc::Status Voxelize(grpc::ServerContext*, const v1::VoxelizeRequest* request,
                        grpc::ServerWriter<v1::VoxelizeResponse>*) override {
    ++calls;
    received = *request;
    return {grpc::StatusCode::FAILED_PRECONDITION, "kept"};
  }
  grpc::Status VoxelizeUpload(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::VoxelizeResponse, v1::VoxelizeUploadRequest>* stream) override {
    ++calls;
    v1::VoxelizeUploadRequest message;
    while (stream->Read(&message)) {
      if (message.has_request()) received = message.request();
      if (message.has_piece() && message.crc32c() == Crc(message.piece())) uploaded += message.piece();
    }
    return {grpc::StatusCode::FAILED_PRECONDITION, "kept"};
  }
  grpc::Status EstimateVoxelization(grpc::ServerContext*, const v1::EstimateVoxelizationRequest*,
                                    v1::EstimateVoxelizationResponse*) override {
    ++calls;
    return {grpc::StatusCode::FAILED_PRECONDITION, "kept"};
  }
  grpc::Status UploadMesh(grpc::ServerContext*, grpc::ServerReader<v1::UploadMeshRequest>* stream,
                          v1::Mesh* response) override {
    v1::UploadMeshRequest message;
    while (stream->Read(&message)) {
      if (message.has_upload()) upload = message.upload();
    }
    response->set_name(upload_name.empty() ? upload.expected_id() : upload_name);
    response->set_already_stored(true);
    return grpc::Status::OK;
  }
  // Two pages of one mesh each.
  grpc::Status ListMeshes(grpc::ServerContext*, const v1::ListMeshesRequest* request,
                          v1::ListMeshesResponse* response) override {
    const bool first = request->page_token().empty();
    response->add_meshes()->set_name(first ? kFirst : second_name);
    if (first) response->set_next_page_token("more");
    return first || request->page_token() == "more" ? grpc::Status::OK : grpc::Status::CANCELLED;
  }
  grpc::Status ReleaseMesh(grpc::ServerContext*, const v1::ReleaseMeshRequest* request,
                           v1::ReleaseMeshResponse* response) override {
    released = request->name();
    response->set_freed_bytes(5);
    return grpc::Status::OK;
  }
  grpc::Status DeleteMesh(grpc::ServerContext*, const v1::DeleteMeshRequest* request,
                          v1::DeleteMeshResponse* response) override {
    deleted = request->name();
    response->set_freed_bytes(-6);
    return grpc::Status::OK;
  }

  static uint32_t Crc(const std::string& bytes) {
    return Crc32c({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
  }

  const std::string kFirst = absl::StrCat("meshes/", std::string(64, '1'), "-mm-stl");
  std::string second_name = absl::StrCat("meshes/", std::string(64, '2'));
  std::string upload_name;  // empty: the expected one
  v1::VoxelizeRequest received;
  v1::MeshUpload upload;
  std::string uploaded, released, deleted;
  int calls = 0;
};

class ClientTest : public ::testing::Test {
 protected:
  KeepingService service_;
  const Serving serving_{service_};
  const std::unique_ptr<Client> client_ = serving_.Connect();
  const JobContext job_;
  const std::vector<uint8_t> small_ = std::vector<uint8_t>(5, 7), large_ = std::vector<uint8_t>(3'000'000, 9);
  const MeshFileType millimetres_{MeshFormat::kStl, LengthUnit::kMillimetre};
};

TEST_F(ClientTest, ASmallMeshGoesInOneMessage) {
  EXPECT_TRUE(absl::IsFailedPrecondition(client_->Voxelize(small_, millimetres_, VoxelizeRequest(), job_).status()));
  const v1::MeshBytes& mesh = service_.received.mesh().bytes();
  EXPECT_EQ(mesh.data(), std::string(5, 7));
  EXPECT_TRUE(mesh.has_crc32c());
  EXPECT_EQ(mesh.crc32c(), Crc32c(small_));
  EXPECT_EQ(mesh.format(), v1::MESH_FORMAT_STL);
  EXPECT_EQ(mesh.unit(), v1::LENGTH_UNIT_MILLIMETRE);
  EXPECT_EQ(service_.received.spec().targets_size(), 1);
  EXPECT_EQ(service_.uploaded, "");
}

TEST_F(ClientTest, ALargeMeshFollowsItsRequest) {
  EXPECT_TRUE(absl::IsFailedPrecondition(client_->Voxelize(large_, millimetres_, VoxelizeRequest(), job_).status()));
  EXPECT_TRUE(service_.received.mesh().has_bytes());
  EXPECT_EQ(service_.received.mesh().bytes().data(), "");
  EXPECT_EQ(service_.received.mesh().bytes().format(), v1::MESH_FORMAT_STL);
  EXPECT_EQ(service_.uploaded, std::string(large_.begin(), large_.end()));
}

TEST_F(ClientTest, NewPositionsOfAStoredMeshGoTheSameWays) {
  const std::vector<float> few(6, 1), many(600'000, 2);
  const auto call = [&](std::span<const float> positions) {
    service_.uploaded.clear();
    EXPECT_TRUE(
        absl::IsFailedPrecondition(client_->VoxelizeStored("meshes/x", VoxelizeRequest(), job_, positions).status()));
    EXPECT_EQ(service_.received.mesh().stored().name(), "meshes/x");
  };
  call({});
  EXPECT_FALSE(service_.received.mesh().stored().has_positions());
  call(few);
  EXPECT_EQ(service_.received.mesh().stored().positions().data().size(), 24u);
  EXPECT_EQ(service_.received.mesh().stored().positions().crc32c(),
            KeepingService::Crc(service_.received.mesh().stored().positions().data()));
  call(many);
  EXPECT_TRUE(service_.received.mesh().stored().has_positions());
  EXPECT_EQ(service_.received.mesh().stored().positions().data(), "");
  EXPECT_EQ(service_.uploaded.size(), 2'400'000u);
}

// Messages could not say what is wrong with these: the error is that of a run in this process.
TEST_F(ClientTest, AGridInNoFormIsRefusedAsInProcess) {
  std::vector<GridRequest> grids(3);
  grids[0].dims = {4, 4, 4};
  grids[0].voxel_size = Vec3d{1, 1, 1};
  grids[1].fit = GridFit::kCube;
  grids[1].voxel_size = Vec3d{1, 1, 1};
  grids[2].origin = Vec3d{0, 0, 0};
  for (const GridRequest& grid : grids) {
    VoxelizeRequest request;
    request.grid = grid;
    const absl::Status expected = FitGrid(grid, Box3d{{0, 0, 0}, {1, 1, 1}, false}).status();
    ASSERT_FALSE(expected.ok());
    EXPECT_EQ(client_->Voxelize(small_, MeshFormat::kGlb, request, job_).status(), expected);
    EXPECT_EQ(client_->VoxelizeStored("meshes/x", request, job_).status(), expected);
    EXPECT_EQ(client_->Estimate(small_, MeshFormat::kGlb, request, job_).status(), expected);
    EXPECT_EQ(client_->Estimate(1, 3, Box3d(), request, job_).status(), expected);
    EXPECT_EQ(client_->OpenMany(job_)->Send(1, small_, MeshFormat::kGlb, request), expected);
  }
  EXPECT_EQ(service_.calls, 0);
}

TEST_F(ClientTest, AnUploadNamesItsMeshAsTheServerDoes) {
  for (const MeshFileType type : {MeshFileType{}, millimetres_, MeshFileType(MeshFormat::kObj)}) {
    const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(small_, type, job_);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    EXPECT_TRUE(mesh->already_stored);
    EXPECT_EQ(mesh->name, MeshNameOf(small_, type));
    EXPECT_EQ(service_.upload.format() == v1::MESH_FORMAT_UNSPECIFIED, type.format == MeshFormat::kAuto);
    EXPECT_EQ(service_.upload.unit() == v1::LENGTH_UNIT_UNSPECIFIED, type.unit == LengthUnit::kNone);
  }
}

TEST_F(ClientTest, AnUploadUnderAnotherNameIsLost) {
  service_.upload_name = service_.kFirst;
  EXPECT_TRUE(absl::IsDataLoss(client_->UploadMesh(small_, MeshFormat::kGlb, job_).status()));
  service_.upload_name = "elsewhere";
  const absl::Status status = client_->UploadMesh(small_, MeshFormat::kGlb, job_).status();
  EXPECT_TRUE(absl::IsDataLoss(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("'elsewhere'"));
}

TEST_F(ClientTest, AListOfMeshesHasAllPages) {
  const absl::StatusOr<std::vector<StoredMesh>> meshes = client_->ListMeshes();
  ASSERT_TRUE(meshes.ok()) << meshes.status();
  std::vector<std::string> names;
  for (const StoredMesh& mesh : *meshes) names.push_back(mesh.name);
  EXPECT_THAT(names, ElementsAre(service_.kFirst, service_.second_name));
  service_.second_name = "meshes/../x";
  EXPECT_TRUE(absl::IsDataLoss(client_->ListMeshes().status()));
}

TEST_F(ClientTest, ToReleaseAMeshIsNotToDeleteIt) {
  EXPECT_EQ(client_->ReleaseMesh("meshes/a").value_or(0), 5u);
  EXPECT_EQ(service_.released, "meshes/a");
  EXPECT_EQ(service_.deleted, "");
  EXPECT_EQ(client_->DeleteMesh("meshes/b").value_or(1), 0u) << "a negative count";
  EXPECT_EQ(service_.deleted, "meshes/b");
}

TEST(ClientContractTest, AServerOfAnotherContractIsNamed) {
  v1::VoxelizationService::Service unknown;
  const Serving serving(unknown);
  const std::unique_ptr<Client> client = serving.Connect();
  const JobContext job;
  const std::vector<uint8_t> mesh(5);
  const auto stream = client->OpenMany(job);
  for (const absl::Status& status :
       {client->ServerInfo().status(), client->ListShaders().status(), client->GetMesh("meshes/x").status(),
        client->Voxelize(mesh, MeshFormat::kGlb, VoxelizeRequest(), job).status(),
        client->UploadMesh(mesh, MeshFormat::kGlb, job).status(), stream->Receive().status()}) {
    EXPECT_TRUE(absl::IsUnimplemented(status)) << status;
    EXPECT_EQ(std::string(status.message()), absl::StrCat("the server at ", serving.target(),
                                                          " speaks another version of the contract than this client, "
                                                          "which is made for revision ",
                                                          kContractRevision));
  }
}

}  // namespace
}  // namespace voxelpipe::testing
