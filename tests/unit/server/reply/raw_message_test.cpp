#include "reply/raw_message.h"

#include <string>
#include <vector>

#include <grpcpp/support/slice.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "mesh/placed_mesh.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

// In slices of `slice_bytes`, as a message comes from the network.
grpc::ByteBuffer InSlices(const std::string& bytes, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < bytes.size(); at += slice_bytes) slices.emplace_back(bytes.substr(at, slice_bytes));
  return grpc::ByteBuffer(slices.data(), slices.size());
}

template <typename Message>
absl::Status Read(const Message& sent, Message& read, size_t slice_bytes = 16 << 10) {
  grpc::ByteBuffer bytes = InSlices(sent.SerializeAsString(), slice_bytes);
  return ReadMessage(bytes, read);
}

std::string Settings(size_t bytes) {
  return std::string(bytes, 'n');
}

constexpr size_t kLargeMesh = 3 << 20;

// What is read is what was sent.
template <typename Message>
void ExpectRead(const Message& sent, size_t slice_bytes = 16 << 10) {
  Message read;
  const absl::Status status = Read(sent, read, slice_bytes);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(read.SerializeAsString(), sent.SerializeAsString());
}
template <typename Message>
void ExpectTooMuch(const Message& sent) {
  Message read;
  EXPECT_THAT(std::string(Read(sent, read).message()), HasSubstr("message: at most 1048576"));
}

TEST(RawMessageTest, MeshBytesDoNotCountWhereverSlicesEnd) {
  const std::string mesh(kLargeMesh, '\x0a');
  v1::VoxelizeRequest by_file, by_positions;
  by_file.mutable_mesh()->mutable_bytes()->set_data(mesh);
  by_file.mutable_mesh()->mutable_bytes()->set_format(v1::MESH_FORMAT_OBJ);
  by_file.mutable_spec()->set_strict(true);
  by_positions.mutable_mesh()->mutable_stored()->set_name("x");
  by_positions.mutable_mesh()->mutable_stored()->mutable_positions()->set_data(mesh);
  v1::VoxelizeUploadRequest piece, first, positions;
  piece.set_piece(mesh);
  piece.set_crc32c(7);
  *first.mutable_request() = by_file;
  *positions.mutable_request() = by_positions;
  v1::VoxelizeBatchRequest batch;
  for (uint64_t id = 1; id < 9; ++id) {
    v1::BatchJob& job = *batch.add_jobs();
    job.set_id(id);
    *job.mutable_request() = id % 2 == 0 ? by_file : by_positions;
    batch.add_cancel(id);
  }
  v1::EstimateVoxelizationRequest estimate;
  estimate.mutable_mesh()->mutable_bytes()->set_data(mesh);
  v1::CreateMeshRequest create;
  create.mutable_mesh()->set_data(mesh);
  v1::UploadMeshRequest upload;
  upload.set_piece(mesh);
  for (const size_t slice_bytes : {size_t{4097}, size_t{1} << 20, size_t{1} << 30}) {
    ExpectRead(by_file, slice_bytes);
    ExpectRead(by_positions, slice_bytes);
    ExpectRead(piece, slice_bytes);
    ExpectRead(first, slice_bytes);
    ExpectRead(positions, slice_bytes);
    ExpectRead(batch, slice_bytes);
    ExpectRead(estimate, slice_bytes);
    ExpectRead(create, slice_bytes);
    ExpectRead(upload, slice_bytes);
  }
}

TEST(RawMessageTest, AllElseIsBounded) {
  v1::VoxelizeRequest request;
  v1::StoredMesh& stored = *request.mutable_mesh()->mutable_stored();
  stored.set_name(Settings(kMaxSettingsBytes / 2));
  ExpectRead(request);
  stored.set_name(Settings(kMaxSettingsBytes));  // and some bytes for keys and lengths
  ExpectTooMuch(request);
  stored.mutable_positions()->set_data(std::string(kLargeMesh, 'm'));
  ExpectTooMuch(request);
  v1::VoxelizeUploadRequest upload;
  *upload.mutable_request() = request;
  ExpectTooMuch(upload);
  v1::VoxelizeRequest spec;
  spec.mutable_mesh()->mutable_bytes()->set_data(std::string(kLargeMesh, 'm'));
  ExpectRead(spec);
  spec.mutable_spec()->mutable_vertex_shader()->set_name(Settings(kMaxSettingsBytes));
  ExpectTooMuch(spec);
  // Of all jobs of a message together.
  v1::VoxelizeBatchRequest batch;
  stored.set_name(Settings(kMaxSettingsBytes / 2));
  for (int jobs = 1; jobs <= 3; ++jobs) {
    *batch.add_jobs()->mutable_request() = request;
    jobs < 2 ? ExpectRead(batch) : ExpectTooMuch(batch);
  }
  v1::VoxelizeBatchRequest cancels;
  for (size_t id = 0; id <= kMaxSettingsBytes; ++id) cancels.add_cancel(1);
  ExpectTooMuch(cancels);
  v1::GetMeshRequest get;
  get.set_name(Settings(kMaxSettingsBytes));
  ExpectTooMuch(get);
  v1::ListMeshesRequest list;
  list.set_page_token(Settings(kMaxSettingsBytes));
  ExpectTooMuch(list);
}

TEST(RawMessageTest, OnlyTheFieldsOfAMeshDoNotCount) {
  v1::VoxelizeRequest request;
  request.mutable_spec()->mutable_vertex_shader()->set_name(Settings(kLargeMesh));
  request.mutable_mesh()->mutable_bytes()->set_data("m");
  ExpectTooMuch(request);
  // Data of an estimate's new positions, which it does not take.
  v1::EstimateVoxelizationRequest estimate;
  estimate.mutable_mesh()->mutable_stored()->mutable_positions()->set_data(Settings(kLargeMesh));
  ExpectTooMuch(estimate);
}

// One of a list with everything in it.
v1::PlacedMesh Placed(size_t name_bytes) {
  v1::PlacedMesh mesh;
  mesh.set_mesh("meshes/" + std::string(64, 'a'));
  for (int i = 0; i < 16; ++i) mesh.add_matrix(i + 0.1);
  mesh.set_name(std::string(name_bytes, 'n'));
  mesh.set_label(4'000'000'000);
  mesh.set_priority(-1);
  for (v1::Vec3* vec : {mesh.mutable_motion()->mutable_linear(), mesh.mutable_motion()->mutable_angular(),
                        mesh.mutable_motion()->mutable_center()}) {
    vec->set_x(1);
    vec->set_y(2);
    vec->set_z(3);
  }
  return mesh;
}

// As many as may be placed, in any call.
TEST(RawMessageTest, PlacedMeshesDoNotCount) {
  v1::VoxelizeRequest request;
  request.mutable_spec()->mutable_vertex_shader()->set_name(Settings(kMaxSettingsBytes - 100));
  v1::PlacedMeshes& placed = *request.mutable_mesh()->mutable_placed();
  for (size_t i = 0; i < kMaxPlacedMeshes; ++i) *placed.add_meshes() = Placed(300);
  ExpectRead(request);
  v1::VoxelizeUploadRequest upload;
  *upload.mutable_request() = request;
  ExpectRead(upload);
  v1::ExportFileRequest file;
  *file.mutable_request() = request;
  ExpectRead(file);
  v1::EstimateVoxelizationRequest estimate;
  *estimate.mutable_mesh() = request.mesh();
  ExpectRead(estimate);
  v1::VoxelizeBatchRequest batch;
  *batch.add_jobs()->mutable_request() = request;
  ExpectRead(batch);
  // Of all jobs of a message together.
  v1::PlacedMeshes& more = *batch.add_jobs()->mutable_request()->mutable_mesh()->mutable_placed();
  *more.add_meshes() = Placed(1);
  ExpectTooMuch(batch);
}

// What takes more memory than bytes does.
TEST(RawMessageTest, UnknownFieldsOfPlacedMeshesCount) {
  v1::VoxelizeRequest request;
  v1::PlacedMeshes& placed = *request.mutable_mesh()->mutable_placed();
  for (int i = 0; i < 1000; ++i) placed.add_meshes()->mutable_motion()->mutable_linear()->set_x(1);
  ExpectRead(request);
  for (const auto of :
       {+[](v1::PlacedMesh& mesh) -> google::protobuf::Message& { return mesh; },
        +[](v1::PlacedMesh& mesh) -> google::protobuf::Message& { return *mesh.mutable_motion(); },
        +[](v1::PlacedMesh& mesh) -> google::protobuf::Message& { return *mesh.mutable_motion()->mutable_linear(); }}) {
    v1::VoxelizeRequest unknown = request;
    for (v1::PlacedMesh& mesh : *unknown.mutable_mesh()->mutable_placed()->mutable_meshes()) {
      google::protobuf::Message& message = of(mesh);
      for (int i = 0; i < 600; ++i) message.GetReflection()->MutableUnknownFields(&message)->AddLengthDelimited(9);
    }
    ExpectTooMuch(unknown);
  }
}

// Else the fields behind are looked at for nothing.
TEST(RawMessageTest, CountingStopsWhereTooMuchHasCome) {
  const std::string settings(2 * kMaxSettingsBytes, '\x08');  // field 1 of number 8, again and again
  grpc::ByteBuffer bytes = InSlices(settings + "\x12\xff\xff\xff\x7f", 16 << 10);
  v1::VoxelizeRequest read;
  EXPECT_THAT(std::string(ReadMessage(bytes, read).message()), HasSubstr("at most 1048576"));
}

// A length that reaches beyond its message hides nothing behind it.
TEST(RawMessageTest, LengthsThatLieAreRefused) {
  const std::string settings(2 * kMaxSettingsBytes, '\0');
  for (const std::string& lie : {std::string("\x12\xff\xff\xff\x7f", 5),                               // of a piece
                                 std::string("\x0a\xff\xff\xff\x7f", 5),                               // a request
                                 std::string("\x0a\x08\x0a\x06\x0a\x04\x0a\xff\xff\x7f", 10),          // its mesh
                                 std::string("\x0a\x0a\x0a\x08\x12\x06\x12\x04\x0a\xff\xff\x7f", 12),  // its positions
                                 std::string("\x12\xff\xff\xff\xff\xff\x01", 7)}) {                    // beyond 32 bits
    grpc::ByteBuffer bytes = InSlices(lie + settings, 16 << 10);
    v1::VoxelizeUploadRequest read;
    const absl::Status status = ReadMessage(bytes, read);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("message: its fields do not end where it ends"));
  }
}

TEST(RawMessageTest, WhatIsNoMessageIsNamed) {
  grpc::ByteBuffer bytes = InSlices("\xff\xff\xff", 16);
  v1::DeleteMeshRequest read;
  EXPECT_EQ(ReadMessage(bytes, read), absl::InvalidArgumentError("message: not a DeleteMeshRequest"));
}

}  // namespace
}  // namespace voxelpipe
