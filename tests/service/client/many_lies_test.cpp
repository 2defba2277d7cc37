// Answers on a stream of many jobs that no honest server gives.
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
  explicit LyingService(v1::VoxelizeManyResponse response) : response_(std::move(response)) {
    builder_.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder_.RegisterService(this);
    server_ = builder_.BuildAndStart();
  }
  grpc::Status VoxelizeMany(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::VoxelizeManyResponse, v1::VoxelizeManyRequest>* stream) override {
    v1::VoxelizeManyRequest request;
    if (stream->Read(&request)) stream->Write(response_);
    while (stream->Read(&request)) {}
    return grpc::Status::OK;
  }
  std::string target() const { return absl::StrCat("127.0.0.1:", port_); }

 private:
  v1::VoxelizeManyResponse response_;
  int port_ = 0;
  grpc::ServerBuilder builder_;
  std::unique_ptr<grpc::Server> server_;
};

// The error of a stream whose one job, 7, gets this response.
absl::Status ErrorOf(const v1::VoxelizeManyResponse& response) {
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

TEST(ManyLiesTest, AnErrorOfTheCodeOkIsNoResult) {
  v1::VoxelizeManyResponse response;
  response.set_id(7);
  response.mutable_error()->set_message("fine");
  ExpectLost(ErrorOf(response), "an error of the code OK");
}

TEST(ManyLiesTest, AnAnswerToNoJobEndsTheStream) {
  v1::VoxelizeManyResponse response;
  response.set_id(UINT64_MAX);
  response.mutable_whole();
  ExpectLost(ErrorOf(response), "to job 18446744073709551615");
}

TEST(ManyLiesTest, AWholeResultIsNoPart) {
  v1::VoxelizeManyResponse response;
  response.set_id(7);
  response.mutable_part()->mutable_whole();
  ExpectLost(ErrorOf(response), "a whole result as a part");
}

}  // namespace
}  // namespace voxelpipe::testing
