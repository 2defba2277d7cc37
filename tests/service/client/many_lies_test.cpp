// Replies on a stream of many jobs that no honest server gives.
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "many_stream.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

// Answers the first job with one response.
class LyingService final : public v1::VoxelizationService::Service {
 public:
  explicit LyingService(v1::VoxelizeBatchResponse response) : response_(std::move(response)) {
    builder_.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder_.RegisterService(this);
    server_ = builder_.BuildAndStart();
  }
  grpc::Status VoxelizeBatch(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::VoxelizeBatchResponse, v1::VoxelizeBatchRequest>* stream) override {
    v1::VoxelizeBatchRequest request;
    if (stream->Read(&request)) stream->Write(response_);
    while (stream->Read(&request)) {}
    return grpc::Status::OK;
  }
  std::string target() const { return absl::StrCat("127.0.0.1:", port_); }

 private:
  v1::VoxelizeBatchResponse response_;
  int port_ = 0;
  grpc::ServerBuilder builder_;
  std::unique_ptr<grpc::Server> server_;
};

// The error of a stream whose one job, 7, gets this response.
absl::Status ErrorOf(const v1::VoxelizeBatchResponse& response) {
  const LyingService service(response);
  const auto client = Client::Connect(service.target());
  if (!client.ok()) return client.status();
  const JobContext job;
  const std::unique_ptr<ManyStream> stream = (*client)->OpenMany(job);
  const std::vector<uint8_t> mesh(9);
  if (absl::Status s = stream->Send(7, mesh, MeshFormat::kGlb, VoxelizeRequest()); !s.ok()) return s;
  stream->FinishSending();
  return stream->Receive().status();
}

void ExpectLost(const absl::Status& status, const std::string& why) {
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(why));
}

v1::VoxelizeBatchResponse Reply(uint64_t id, const v1::VoxelizeResponse& part = {}) {
  v1::VoxelizeBatchResponse response;
  v1::BatchReply& reply = *response.add_replies();
  reply.set_id(id);
  *reply.mutable_response() = part;
  return response;
}

TEST(ManyLiesTest, AnErrorOfTheCodeOkIsNoResult) {
  v1::VoxelizeBatchResponse response;
  response.add_replies()->set_id(7);
  response.mutable_replies(0)->mutable_error()->set_message("fine");
  ExpectLost(ErrorOf(response), "an error of the code OK");
}

TEST(ManyLiesTest, AReplyToNoJobEndsTheStream) {
  ExpectLost(ErrorOf(Reply(UINT64_MAX)), "to job 18446744073709551615");
}

TEST(ManyLiesTest, AReplyAfterTheLastOneIsToNoJob) {
  v1::VoxelizeBatchResponse response;
  for (int i = 0; i < 2; ++i) {
    response.add_replies()->set_id(7);
    response.mutable_replies(i)->mutable_error()->set_code(int(grpc::StatusCode::NOT_FOUND));
  }
  const LyingService service(response);
  const auto client = Client::Connect(service.target());
  ASSERT_TRUE(client.ok()) << client.status();
  const JobContext job;
  const std::unique_ptr<ManyStream> stream = (*client)->OpenMany(job);
  ASSERT_TRUE(stream->Send(7, std::vector<uint8_t>(9), MeshFormat::kGlb, VoxelizeRequest()).ok());
  const absl::StatusOr<ManyAnswer> answer = stream->Receive();
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_TRUE(absl::IsNotFound(answer->result.status())) << answer->result.status();
  ExpectLost(stream->Receive().status(), "to job 7");
}

TEST(ManyLiesTest, APieceBeforeTheHeaderEndsTheStream) {
  v1::VoxelizeResponse part;
  part.add_pieces()->set_data("x");
  ExpectLost(ErrorOf(Reply(7, part)), "a piece before the header");
}

// Nothing follows it, so the other jobs are not concerned.
TEST(ManyLiesTest, ASummaryWithoutAHeaderFailsItsJobAlone) {
  v1::VoxelizeResponse part;
  part.mutable_summary();
  const LyingService service(Reply(7, part));
  const auto client = Client::Connect(service.target());
  ASSERT_TRUE(client.ok()) << client.status();
  const JobContext job;
  const std::unique_ptr<ManyStream> stream = (*client)->OpenMany(job);
  ASSERT_TRUE(stream->Send(7, std::vector<uint8_t>(9), MeshFormat::kGlb, VoxelizeRequest()).ok());
  stream->FinishSending();
  const absl::StatusOr<ManyAnswer> answer = stream->Receive();
  ASSERT_TRUE(answer.ok()) << answer.status();
  ExpectLost(answer->result.status(), "a summary before the header");
  EXPECT_TRUE(absl::IsOutOfRange(stream->Receive().status()));
}

}  // namespace
}  // namespace voxelpipe::testing
