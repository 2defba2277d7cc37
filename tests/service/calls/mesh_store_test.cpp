// Meshes that the server keeps: uploaded once, used many times.
#include <openssl/sha.h>

#include <cstring>
#include <future>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/escaping.h"
#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "service/support/background_call.h"
#include "service/support/effort.h"
#include "service/support/mesh_store_fixture.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

// By OpenSSL, which knows nothing of our own hash.
std::string NameOf(const std::vector<uint8_t>& bytes) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(bytes.data(), bytes.size(), digest);
  return "meshes/" + absl::BytesToHexString({reinterpret_cast<const char*>(digest), sizeof digest});
}

// The name of no mesh that is there.
std::string Missing(char digit) {
  return "meshes/" + std::string(64, digit);
}

v1::UploadMeshRequest Begin(const std::string& expected_id = "") {
  v1::UploadMeshRequest message;
  message.mutable_upload()->set_expected_id(expected_id);
  return message;
}

v1::UploadMeshRequest Piece(const std::vector<uint8_t>& bytes) {
  v1::UploadMeshRequest message;
  message.set_piece(bytes.data(), bytes.size());
  return message;
}

TEST_F(MeshStoreTest, AMeshIsKeptUnderTheHashOfItsBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const StoredMesh first = Upload(glb_);
  EXPECT_EQ(first.name, NameOf(glb_));
  EXPECT_EQ(first.format, MeshFormat::kGlb);
  EXPECT_EQ(first.file_bytes, glb_.size());
  EXPECT_GT(first.memory_bytes, 0u);
  EXPECT_EQ(first.report.triangles, 288u);
  EXPECT_EQ(first.uses, 0u);
  EXPECT_FALSE(first.already_stored);

  const StoredMesh again = Upload(glb_);
  EXPECT_TRUE(again.already_stored);
  EXPECT_EQ(again.name, first.name);

  HashOfStored(first.name, SmallRequest());
  const absl::StatusOr<StoredMesh> known = client_->GetMesh(first.name);
  ASSERT_TRUE(known.ok()) << known.status();
  EXPECT_EQ(known->uses, 1u);
  EXPECT_EQ(known->report.triangles, 288u);
}

TEST_F(MeshStoreTest, AStoredMeshGivesTheBytesOfItsFile) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(glb_).name;
  for (const VoxelizeRequest& request : Requests()) {
    const std::string file = HashOfFile(glb_, request);
    EXPECT_EQ(HashOfStored(name, request), file);
    EXPECT_EQ(HashOfStored(name, request), file) << "the second time too";
  }
}

TEST_F(MeshStoreTest, ManyJobsUseOneMeshAtTheSameTime) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "4"}));
  const std::string name = Upload(glb_).name;
  const std::vector<VoxelizeRequest> requests = Requests();
  std::vector<std::string> expected;
  for (const VoxelizeRequest& request : requests) expected.push_back(HashOfFile(glb_, request));
  std::vector<std::future<std::string>> hashes;
  for (size_t i = 0; i < 24; ++i) {
    VoxelizeRequest request = requests[i % requests.size()];
    hashes.push_back(std::async(std::launch::async, [=, this] { return HashOfStored(name, request); }));
  }
  for (size_t i = 0; i < hashes.size(); ++i) EXPECT_EQ(hashes[i].get(), expected[i % expected.size()]) << i;
}

TEST_F(MeshStoreTest, AnEstimateKnowsStoredMeshes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto of_file = client_->Estimate(glb_, MeshFormat::kAuto, SmallRequest(), job_);
  ASSERT_TRUE(of_file.ok()) << of_file.status();
  const std::string name = Upload(glb_).name;
  const auto of_stored = client_->EstimateStored(name, SmallRequest(), job_);
  ASSERT_TRUE(of_stored.ok()) << of_stored.status();
  EXPECT_EQ(of_stored->plan.grid, of_file->plan.grid);
  EXPECT_EQ(of_stored->plan.peak_bytes, of_file->plan.peak_bytes);
  EXPECT_EQ(of_stored->report.vertices, of_file->report.vertices);
  EXPECT_TRUE(absl::IsNotFound(client_->EstimateStored(Missing('0'), SmallRequest(), job_).status()));
}

TEST_F(MeshStoreTest, WhatIsNotKeptIsNamed) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Missing('a');
  EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(name).status()));
  EXPECT_TRUE(absl::IsNotFound(client_->ReleaseMesh(name).status()));
  EXPECT_TRUE(absl::IsNotFound(client_->DeleteMesh(name).status()));
  EXPECT_EQ(MissingMesh(client_->GetMesh(name).status()), name);
  EXPECT_EQ(MissingMesh(client_->ReleaseMesh(name).status()), name);
  EXPECT_EQ(MissingMesh(client_->DeleteMesh(name).status()), name);
  const absl::Status status = client_->VoxelizeStored(name, SmallRequest(), job_).status();
  EXPECT_TRUE(absl::IsNotFound(status)) << status;
  EXPECT_EQ(MissingMesh(status), name) << "ResourceInfo came along";
  for (const std::string& wrong : {std::string(64, 'a'), "meshes/" + std::string(63, 'a'), Missing('A'), name + "-km",
                                   std::string("meshes/../etc/passwd"), std::string()}) {
    for (const absl::Status& refused :
         {client_->GetMesh(wrong).status(), client_->ReleaseMesh(wrong).status(), client_->DeleteMesh(wrong).status(),
          client_->EstimateStored(wrong, SmallRequest(), job_).status(),
          client_->VoxelizeStored(wrong, SmallRequest(), job_).status()}) {
      EXPECT_TRUE(absl::IsInvalidArgument(refused)) << wrong << ": " << refused;
    }
  }
}

TEST_F(MeshStoreTest, AMeshThatIsDeletedInUseServesItsJobsToTheEnd) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "2"}));
  const std::vector<uint8_t> slow = LargeTrianglesGlb(LessIfSlow(2000));
  VoxelizeRequest request = SlowRequest();
  request.grid.resolution = 128;
  const std::string expected = HashOfFile(slow, request);
  for (const bool by_release : {true, false}) {
    const std::string name = Upload(slow).name;
    std::promise<void> planned;
    auto running = std::async(std::launch::async, [&] {
      return client_->VoxelizeStored(name, request, job_, {}, [&](const Plan&) { planned.set_value(); });
    });
    ASSERT_EQ(planned.get_future().wait_for(kPatience), std::future_status::ready);
    const absl::StatusOr<uint64_t> freed = by_release ? client_->ReleaseMesh(name) : client_->DeleteMesh(name);
    ASSERT_TRUE(freed.ok()) << freed.status();
    EXPECT_GT(*freed, 0u);
    EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(name).status()));
    const auto result = running.get();
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(result->content_sha256, expected);
  }
}

TEST_F(MeshStoreTest, OtherBytesThanAnnouncedAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = NameOf(glb_);
  std::vector<uint8_t> other = glb_;
  other.back() ^= 1;
  EXPECT_TRUE(absl::IsDataLoss(UploadRaw({Begin(name), Piece(other)})));
  v1::UploadMeshRequest piece = Piece(glb_);
  piece.set_crc32c(Crc32c(glb_) ^ 1);
  EXPECT_TRUE(absl::IsDataLoss(UploadRaw({Begin(), piece})));
  EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(name).status())) << "nothing of it was kept";
  piece.set_crc32c(Crc32c(glb_));
  v1::Mesh response;
  const absl::Status status = UploadRaw({Begin(name), piece}, &response);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(response.name(), name);
}

TEST_F(MeshStoreTest, AnUploadOfAKnownMeshIsAnsweredBeforeItsBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(glb_).name;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  v1::Mesh response;
  const auto stream = stub_->UploadMesh(&context, &response);
  ASSERT_TRUE(stream->Write(Begin(name)));
  const absl::Status status = FromGrpcStatus(stream->Finish());  // the stream is still open on our side
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_TRUE(response.already_stored());
  EXPECT_EQ(response.name(), name);
}

// The same file in another unit is another mesh.
TEST_F(MeshStoreTest, AUnitIsPartOfTheName) {
  ASSERT_NO_FATAL_FAILURE(Start());
  constexpr std::string_view kText =
      "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nv 0 0 1000\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n";
  const std::vector<uint8_t> file(kText.begin(), kText.end());
  const absl::StatusOr<StoredMesh> plain = client_->UploadMesh(file, {}, JobContext());
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_EQ(plain->name, NameOf(file));
  EXPECT_EQ(plain->report.max.x, 1000);
  const absl::StatusOr<StoredMesh> scaled =
      client_->UploadMesh(file, {MeshFormat::kObj, LengthUnit::kMillimetre}, JobContext());
  ASSERT_TRUE(scaled.ok()) << scaled.status();
  EXPECT_NE(scaled->name, plain->name);
  EXPECT_FALSE(scaled->already_stored);
  EXPECT_EQ(scaled->unit, LengthUnit::kMillimetre);
  EXPECT_EQ(scaled->report.max.x, 1);
  const absl::StatusOr<StoredMesh> again = client_->GetMesh(scaled->name);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->report.max.x, 1);
  VoxelizeRequest request = SmallRequest();
  const absl::StatusOr<RemoteResult> stored = client_->VoxelizeStored(scaled->name, request, JobContext());
  const absl::StatusOr<RemoteResult> sent =
      client_->Voxelize(file, {MeshFormat::kObj, LengthUnit::kMillimetre}, request, JobContext());
  ASSERT_TRUE(stored.ok()) << stored.status();
  ASSERT_TRUE(sent.ok()) << sent.status();
  EXPECT_EQ(stored->content_sha256, sent->content_sha256);
  EXPECT_EQ(stored->result.grid.voxel_size.x, sent->result.grid.voxel_size.x);
  EXPECT_LT(sent->result.grid.voxel_size.x, 1);
  EXPECT_TRUE(absl::IsInvalidArgument(client_->UploadMesh(glb_, {{}, LengthUnit::kMetre}, JobContext()).status()));
}

TEST_F(MeshStoreTest, UploadsThatAreNotOneAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({})));
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({Piece(glb_)})));
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({Begin(), Begin()})));
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({Begin("no name")})));
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({Begin(), Piece({1, 2, 3, 4, 5})}))) << "no mesh";
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({Begin()}))) << "no bytes";
  v1::UploadMeshRequest wrong = Begin();
  wrong.mutable_upload()->set_format(v1::MESH_FORMAT_DRACO);
  EXPECT_TRUE(absl::IsInvalidArgument(UploadRaw({wrong, Piece(glb_)})));
}

TEST_F(MeshStoreTest, TheLongestUnusedMeshGoesWhenThereIsNoRoom) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const uint64_t each = Upload(glb_).memory_bytes;
  ASSERT_NO_FATAL_FAILURE(Start({"--max-mesh-store-bytes", std::to_string(each * 2 + each / 2)}));
  // Three meshes of one size.
  std::vector<std::vector<uint8_t>> files(3, glb_);
  for (size_t i = 0; i < files.size(); ++i) files[i].back() = uint8_t('a' + i);  // of the PNG's last bytes
  const std::string a = Upload(files[0]).name, b = Upload(files[1]).name;
  ASSERT_NE(a, b);
  HashOfStored(a, SmallRequest());
  const std::string c = Upload(files[2]).name;
  EXPECT_TRUE(client_->GetMesh(a).ok());
  EXPECT_TRUE(absl::IsNotFound(client_->GetMesh(b).status()));
  EXPECT_TRUE(client_->GetMesh(c).ok());

  const absl::Status large = client_->UploadMesh(TorusGlb(100), MeshFormat::kAuto, job_).status();
  EXPECT_TRUE(absl::IsResourceExhausted(large)) << large;
  EXPECT_NE(std::string(large.message()).find(std::to_string(each * 2 + each / 2)), std::string::npos) << large;
  EXPECT_TRUE(client_->GetMesh(c).ok()) << "what does not fit puts nothing out";
}

// A body that moves: the positions go to the server, everything else stays there.
TEST_F(MeshStoreTest, NewPositionsEqualAMeshThatWasMoved) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string name = Upload(glb_).name;
  const absl::StatusOr<Scene> scene = LoadScene(glb_);
  ASSERT_TRUE(scene.ok());
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
  ASSERT_TRUE(mesh.ok());
  for (int frame = 0; frame < 3; ++frame) {
    TriangleMesh moved = *mesh;
    std::vector<float> positions;
    for (const Vec3d& p : mesh->positions) {
      positions.insert(positions.end(), {float(p.x * (1 + 0.1 * frame)), float(p.y + 0.2 * frame), float(p.z)});
    }
    for (size_t i = 0; i < moved.positions.size(); ++i) {
      moved.positions[i] = {positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]};
    }
    for (const Fill fill : {Fill::kNone, Fill::kParity}) {
      VoxelizeRequest request;
      request.grid.resolution = 24;
      request.fill = fill;
      request.targets[0].format = VoxelFormat::kF32;
      request.targets[0].components = 3;
      request.targets[0].blend = Blend::kReplace;
      request.targets[0].shader = {"normal", {}};
      const auto expected = Voxelize(moved, request, {job_});
      ASSERT_TRUE(expected.ok()) << expected.status();
      const auto result = client_->VoxelizeStored(name, request, job_, positions);
      ASSERT_TRUE(result.ok()) << result.status();
      const auto want = ArraysOf(*expected), got = ArraysOf(result->result);
      ASSERT_EQ(want.size(), got.size());
      for (size_t i = 0; i < want.size(); ++i) {
        ASSERT_EQ(want[i].size(), got[i].size());
        EXPECT_EQ(std::memcmp(want[i].data(), got[i].data(), want[i].size()), 0) << "frame " << frame;
      }
      EXPECT_EQ(result->result.grid, expected->grid);
    }
  }
}

// However they come: beside the name, in pieces, or both.
TEST_F(MeshStoreTest, NewPositionsComeInOneMessageOrInPieces) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const StoredMesh mesh = Upload(glb_);
  std::vector<float> positions;
  for (uint64_t i = 0; i < mesh.report.vertices; ++i) {
    positions.insert(positions.end(), {float(i % 7), float(i % 5), float(i % 3)});
  }
  const std::string expected = HashOfStored(mesh.name, SmallRequest(), positions);
  EXPECT_NE(expected, HashOfStored(mesh.name, SmallRequest()));
  const std::string_view bytes(reinterpret_cast<const char*>(positions.data()), positions.size() * sizeof(float));
  v1::VoxelizeRequest request = StoredRequestOf(SmallRequest(), mesh.name);
  v1::MeshPositions& moved = *request.mutable_mesh()->mutable_stored()->mutable_positions();
  const auto in_pieces = [&](size_t first) {
    moved.set_data(std::string(bytes.substr(0, first)));
    std::vector<v1::VoxelizeUploadRequest> messages{UploadOf(request)};
    for (size_t at = first; at < bytes.size(); at += 1001) messages.push_back(PieceOf(bytes.substr(at, 1001)));
    return CallUpload(*stub_, messages);
  };
  for (const size_t first : {size_t{0}, size_t{12}, bytes.size() / 2 + 1, bytes.size()}) {
    const Received received = in_pieces(first);
    ASSERT_TRUE(received.status.ok()) << received.status.error_message();
    EXPECT_EQ(received.summary.content_sha256(), expected) << first;
  }
  moved.set_data(std::string(bytes));
  moved.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}));
  EXPECT_EQ(Call(*stub_, request).summary.content_sha256(), expected);
  moved.set_crc32c(moved.crc32c() ^ 1);
  EXPECT_EQ(Call(*stub_, request).status.error_code(), grpc::StatusCode::DATA_LOSS);
}

TEST_F(MeshStoreTest, NewPositionsThatDoNotFitAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const StoredMesh mesh = Upload(glb_);
  std::vector<float> positions(mesh.report.vertices * 3, 0.5f);
  const auto refusal = [&](std::span<const float> given) {
    const absl::Status status = client_->VoxelizeStored(mesh.name, SmallRequest(), job_, given).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_TRUE(std::string(status.message()).starts_with("mesh.stored.positions: ")) << status;
    return std::string(status.message());
  };
  const std::span<const float> all(positions);
  EXPECT_NE(refusal(all.first(all.size() - 1)).find(std::to_string(all.size_bytes())), std::string::npos);
  std::vector<float> more = positions;
  more.push_back(0);
  EXPECT_NE(refusal(more).find(std::to_string(all.size_bytes())), std::string::npos);
  positions[7 * 3 + 1] = std::numeric_limits<float>::infinity();
  positions[9 * 3 + 1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NE(refusal(positions).find("vertex 7 "), std::string::npos);
}

TEST_F(MeshStoreTest, MeshBytesAfterTheNameOfAMeshAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const v1::VoxelizeRequest request = StoredRequestOf(SmallRequest(), Upload(glb_).name);
  const grpc::Status status = CallUpload(*stub_, {UploadOf(request), PieceOf("glTF")}).status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "mesh.stored: no mesh bytes may follow, unless it has positions");
  EXPECT_TRUE(CallUpload(*stub_, request).status.ok()) << "none are needed";
}

TEST_F(MeshStoreTest, EqualUploadsAtTheSameTimeBecomeOneMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<std::future<StoredMesh>> uploads;
  const std::vector<uint8_t> large = TorusGlb(150);
  for (int i = 0; i < 8; ++i) uploads.push_back(std::async(std::launch::async, [&] { return Upload(large); }));
  for (auto& upload : uploads) EXPECT_EQ(upload.get().name, NameOf(large));
}

}  // namespace
}  // namespace voxelpipe::testing
