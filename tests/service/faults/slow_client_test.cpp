// Clients that are slow, on purpose or not: what they hold is bounded in time, and those who do move are served.
#include <algorithm>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/process_facts.h"
#include "service/support/raw_client.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

class SlowClientTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--log-level", "error", "--workers", "1"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    stub_ = StubOf(*server_);
  }

  void ExpectServed() {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + kPatience);
    const absl::Status status = client_->Voxelize(glb_, MeshFormat::kGlb, SmallRequest(), job).status();
    EXPECT_TRUE(status.ok()) << status;
  }

  static v1::VoxelizeUploadRequest First(const VoxelizeRequest& request) { return UploadOf(RequestOf(request)); }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

// What an upload has to bring in each limit.
constexpr size_t kEnoughBytes = 64 << 10;

// 32 MiB: more than all the buffers between us.
VoxelizeRequest SlowResult() {
  VoxelizeRequest request;
  request.grid.dims = {256, 256, 128};
  request.grid.voxel_size = Vec3d{0.02, 0.02, 0.02};
  request.grid.origin = Vec3d{0, 0, 0};
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kReplace;
  return request;
}

TEST_F(SlowClientTest, AnUploadThatStopsIsLetGo) {
  // Room for one such upload.
  ASSERT_NO_FATAL_FAILURE(Start({"--upload-idle-timeout-ms", "300", "--max-upload-bytes", "100000"}));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub_->VoxelizeUpload(&context);
  ASSERT_TRUE(stream->Write(First(SmallRequest())));
  ASSERT_TRUE(stream->Write(PieceOf(std::string(99'000, 'x'))));
  const grpc::Status status = stream->Finish();  // without a word more
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED) << status.error_message();
  EXPECT_THAT(status.error_message(), HasSubstr("300 ms"));
  ExpectServed();
}

TEST_F(SlowClientTest, ByteAfterByteIsIdleToo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--upload-idle-timeout-ms", "300"}));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub_->VoxelizeUpload(&context);
  ASSERT_TRUE(stream->Write(First(SmallRequest())));
  while (stream->Write(PieceOf("x"))) std::this_thread::sleep_for(milliseconds(5));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED) << status.error_message();
}

TEST_F(SlowClientTest, ACallWithoutAnyMessageIsLetGo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--upload-idle-timeout-ms", "300"}));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub_->VoxelizeUpload(&context);
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::ABORTED);
}

// A slow line is no idle client: it takes several times the limit in all.
TEST_F(SlowClientTest, ASlowUploadThatMovesIsServed) {
  ASSERT_NO_FATAL_FAILURE(Start({"--upload-idle-timeout-ms", "1500"}));
  const std::vector<uint8_t> glb = LargeTrianglesGlb(24'000);
  ASSERT_GT(glb.size(), 12 * kEnoughBytes);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub_->VoxelizeUpload(&context);
  VoxelizeRequest request;
  request.grid.resolution = 4;
  ASSERT_TRUE(stream->Write(First(request)));
  for (size_t at = 0; at < glb.size(); at += kEnoughBytes) {
    const std::span<const uint8_t> rest = std::span(glb).subspan(at);
    ASSERT_TRUE(stream->Write(PieceOf(rest.first(std::min(rest.size(), kEnoughBytes)))));
    std::this_thread::sleep_for(milliseconds(250));
  }
  stream->WritesDone();
  const grpc::Status status = Collect(*stream).status;
  EXPECT_TRUE(status.ok()) << status.error_message();
}

// A result that stands in memory occupies no worker, but memory.
TEST_F(SlowClientTest, ANonReaderDoesNotKeepTheMemory) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stall-timeout-ms", "2000", "--max-working-bytes", "60000000"}));
  const auto ask = [&](grpc::ClientContext& context) {
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    auto stream = stub_->VoxelizeUpload(&context);
    stream->Write(First(SlowResult()));
    stream->Write(PieceOf(glb_));
    stream->WritesDone();
    v1::VoxelizeResponse response;
    EXPECT_TRUE(stream->Read(&response));
    return stream;
  };
  grpc::ClientContext first, second;
  const auto reader = ask(first);
  // There is no room for a second such result before the first one is gone.
  const auto next = ask(second);
  uint64_t bytes = 0;
  v1::VoxelizeResponse response;
  while (next->Read(&response)) {
    for (const v1::ResultPiece& piece : response.pieces()) bytes += piece.data().size();
  }
  const grpc::Status status = next->Finish();
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(bytes, 32u << 20);
  while (reader->Read(&response)) {}
  EXPECT_NE(reader->Finish().error_code(), grpc::StatusCode::OK);
}

// Connections that stop to read, frames and all: gRPC's own buffers and ours stay bounded.
TEST_F(SlowClientTest, TwentyNonReadersAreCheap) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "0", "--stall-timeout-ms", "200"}));
  const ProcessFacts before = ReadProcessFacts(server_->pid());
  std::vector<std::unique_ptr<RawClient>> readers;
  for (int i = 0; i < 20; ++i) {
    auto reader = RawClient::Connect(server_->address(), /*receive_buffer_bytes=*/4096);
    ASSERT_TRUE(reader.ok()) << reader.status();
    readers.push_back(*std::move(reader));
    ASSERT_TRUE(readers.back()->Send(http2::Opening() + http2::Request(1, kUploadMethod) +
                                     http2::Data(1, http2::Message(First(SlowResult()).SerializeAsString()), false) +
                                     http2::Data(1, http2::Message(PieceOf(glb_).SerializeAsString()), true)));
  }
  // The one worker comes to each of them.
  for (const auto& reader : readers) EXPECT_TRUE(reader->ReadUntilData());
  ExpectServed();
  const ProcessFacts after = ReadProcessFacts(server_->pid());
  if (!IsSanitized(server_->pid())) {
    EXPECT_LT(after.peak_bytes, before.resident_bytes + (uint64_t{400} << 20)) << after.ToString();
  }
  readers.clear();
  const ProcessFacts end = SettledProcessFacts(server_->pid());
  EXPECT_LE(end.descriptors, before.descriptors);
}

// What leaves ahead of their windows is the kept result itself, and not a copy for each of them.
TEST_F(SlowClientTest, NonReadersOfAKeptResultShareIt) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "100000000", "--piece-bytes", "262144"}));
  const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(glb_, MeshFormat::kGlb, JobContext());
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  ASSERT_TRUE(client_->VoxelizeStored(mesh->name, SlowResult(), JobContext()).ok());
  const ProcessFacts before = ReadProcessFacts(server_->pid());
  const v1::VoxelizeRequest request = StoredRequestOf(SlowResult(), mesh->name);
  std::vector<std::unique_ptr<RawClient>> readers;
  for (int i = 0; i < 20; ++i) {
    auto reader = RawClient::Connect(server_->address(), /*receive_buffer_bytes=*/4096);
    ASSERT_TRUE(reader.ok()) << reader.status();
    readers.push_back(*std::move(reader));
    ASSERT_TRUE(readers.back()->Send(http2::Opening() + http2::Request(1, kVoxelizeMethod) +
                                     http2::Data(1, http2::Message(request.SerializeAsString()), true)));
  }
  for (const auto& reader : readers) EXPECT_TRUE(reader->ReadUntilData());
  const absl::StatusOr<RemoteResult> again = client_->VoxelizeStored(mesh->name, SlowResult(), JobContext());
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->cached);
  const ProcessFacts after = ReadProcessFacts(server_->pid());
  if (!IsSanitized(server_->pid())) {
    EXPECT_LT(after.resident_bytes, before.resident_bytes + (uint64_t{64} << 20)) << after.ToString();
  }
}

}  // namespace
}  // namespace voxelpipe::testing
