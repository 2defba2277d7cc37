// Answers whose first message is ready together with the next one, on a connection on which nothing else moves: what
// the server puts off until more comes must not wait for the client.
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "many_stream.h"
#include "service/support/effort.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

// Neither hash nor compression: every piece is ready at once, from the first one on.
class WriteAheadTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "warn", "--backend", "cpu", "--workers", "1", "--threads", "1"});
    ASSERT_NE(server_, nullptr);
    ConnectOptions options;
    options.timeout = kPatience;
    options.settings.content_hash = false;
    auto client = Client::Connect(server_->address(), options);
    ASSERT_TRUE(client.ok()) << client.status();
    client_ = *std::move(client);
    request_.grid.resolution = 128;  // 8 MiB at most
    // Less than it takes the server to look after a silent connection, which would free what is stuck.
    job_.set_deadline(JobContext::Clock::now() + kPatience / 2);
  }

  // Takes a while, in which the pings and window updates that came with the request are over.
  const std::vector<uint8_t> slow_ = LargeTrianglesGlb(LessIfSlow(300));
  VoxelizeRequest request_ = SlowRequest();
  JobContext job_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(WriteAheadTest, AStreamOfJobsBeginsWithPiecesThatAreReady) {
  for (uint64_t id = 0; id < 3; ++id) {
    const std::unique_ptr<ManyStream> stream = client_->OpenMany(job_);
    ASSERT_TRUE(stream->Send(id, slow_, MeshFormat::kGlb, request_).ok());
    stream->FinishSending();
    const absl::StatusOr<ManyAnswer> answer = stream->Receive();
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_TRUE(answer->result.ok()) << answer->result.status();
    EXPECT_GT(answer->result->sent_bytes, 2u << 20) << "several pieces";
    EXPECT_EQ(stream->Receive().status().code(), absl::StatusCode::kOutOfRange);
  }
}

TEST_F(WriteAheadTest, ASingleCallSendsPiecesThatAreReady) {
  const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(slow_, MeshFormat::kGlb, job_);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  for (int i = 0; i < 3; ++i) {
    const absl::StatusOr<RemoteResult> sent = client_->Voxelize(slow_, MeshFormat::kGlb, request_, job_);
    ASSERT_TRUE(sent.ok()) << sent.status();
    const absl::StatusOr<RemoteResult> stored = client_->VoxelizeStored(mesh->name, request_, job_);
    ASSERT_TRUE(stored.ok()) << stored.status();
    EXPECT_GT(stored->sent_bytes, 2u << 20) << "several pieces";
  }
}

}  // namespace
}  // namespace voxelpipe::testing
