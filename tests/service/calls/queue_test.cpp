// What a server does with calls that have to wait. Its workers are kept busy by jobs that take a minute or more.
#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/background_call.h"
#include "service/support/http_get.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using std::chrono::milliseconds;

class QueueTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--log-level", "warn", "--threads", "1"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
  }

  std::unique_ptr<BackgroundCall> Slow() {
    return std::make_unique<BackgroundCall>(*client_, LargeTrianglesGlb(20000), SlowRequest());
  }

  // One VoxelizeUpload call with these settings; without its mesh the client never ends its half.
  absl::Status Call(const CallSettings& settings, bool with_mesh = true) {
    const auto stub = StubOf(*server_);
    const v1::VoxelizeRequest request = RequestOf(SmallRequest(), TorusGlb(8), MeshFormat::kGlb, settings);
    if (with_mesh) return FromGrpcStatus(CallUpload(*stub, request).status);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub->VoxelizeUpload(&context);
    stream->Write(UploadOf(RequestOf(SmallRequest(), {}, MeshFormat::kGlb, settings)));
    return FromGrpcStatus(Collect(*stream).status);
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(QueueTest, ATimeOutComesThoughEveryWorkerIsBusy) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1"}));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  CallSettings settings;
  settings.queue_timeout = milliseconds(50);
  const absl::Status status = Call(settings);
  EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded) << status;
  EXPECT_NE(std::string(status.message()).find("in the queue"), std::string::npos) << status;
  EXPECT_FALSE(running->IsOver());
}

TEST_F(QueueTest, TheServersTimeOutIsForCallsThatDoNotSay) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--queue-timeout-ms", "50"}));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  EXPECT_EQ(Call({}).code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_FALSE(running->IsOver());
}

TEST_F(QueueTest, ARefusalComesBeforeTheMesh) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--max-queue", "0"}));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  const absl::Status status = Call({}, false);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_TRUE(RetryDelay(status).has_value()) << status;
}

TEST_F(QueueTest, AFullQueueRefusesBeforeAnythingIsRead) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1", "--max-queue", "0", "--http-listen", "127.0.0.1:0"}));
  const auto running = Slow();
  ASSERT_TRUE(running->WaitUntilPlanned());
  const auto stub = StubOf(*server_);
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    // Nothing is sent, or a request that no server would look at any further.
    const absl::Status status =
        FromGrpcStatus(i % 2 == 0 ? stub->VoxelizeUpload(&context)->Finish() : stub->Voxelize(&context, {})->Finish());
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_TRUE(RetryDelay(status).has_value()) << status;
    EXPECT_NE(std::string(status.message()).find("the queue is full: 1 jobs run and 0 wait"), std::string::npos);
    EXPECT_EQ(context.GetServerInitialMetadata().count("x-request-id") +
                  context.GetServerTrailingMetadata().count("x-request-id"),
              1u);
  }
  const absl::StatusOr<std::string> http = server_->http_address();
  ASSERT_TRUE(http.ok()) << http.status();
  EXPECT_EQ(SampleOf(HttpGet(*http, "/metrics"), "voxelpipe_queue_refusals_total{reason=\"jobs\"}"), 20);
}

// An estimate loads and measures its mesh: what that takes is known before it begins.
TEST_F(QueueTest, AnEstimateIsWeighedAsTheWorkThatItCauses) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "1"}));
  const auto stub = StubOf(*server_);
  VoxelizeRequest request = SmallRequest();
  request.result = ResultKind::kSparse;
  request.fill = Fill::kFlood;
  v1::EstimateVoxelizationRequest estimate;
  *estimate.mutable_spec() = MakeSpec(request);
  v1::MeshBytes& mesh = *estimate.mutable_mesh()->mutable_bytes();
  mesh.set_format(v1::MESH_FORMAT_DRACO);
  mesh.set_data(std::string(60 << 20, 'x'));  // some 20 million triangles, were they any
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(5));
  v1::EstimateVoxelizationResponse response;
  const absl::Status status = FromGrpcStatus(stub->EstimateVoxelization(&context, estimate, &response));
  EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded) << status;
  EXPECT_NE(std::string(status.message()).find("the job would take"), std::string::npos) << status;
}

TEST_F(QueueTest, GiantsDoNotHoldUpTheSmall) {
  ASSERT_NO_FATAL_FAILURE(Start({"--workers", "2", "--giant-job-ms", "10"}));
  const auto first = Slow();
  ASSERT_TRUE(first->WaitUntilPlanned());
  const auto second = Slow(), third = Slow();
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(Call({}).ok());
  EXPECT_FALSE(first->IsOver() || second->IsOver() || third->IsOver());
}

}  // namespace
}  // namespace voxelpipe::testing
