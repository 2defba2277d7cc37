// The forms in which one result comes: in one message or in several, of every call, with the same bytes and hash.
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

constexpr int64_t kMaxBytes = 1 << 20;

class ResponseFormsTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    stub_ = StubOf(*server_);
  }

  // The result by Voxelize, by VoxelizeUpload, and as a job of a batch.
  std::vector<Received> ByEveryCall(const v1::VoxelizeRequest& request) {
    std::vector<Received> all = {Call(*stub_, request), CallUpload(*stub_, request)};
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->VoxelizeBatch(&context);
    v1::VoxelizeBatchRequest message;
    *message.add_jobs() = JobOf(7, request);
    EXPECT_TRUE(stream->Write(message));
    stream->WritesDone();
    std::map<uint64_t, Received> jobs;
    for (v1::VoxelizeBatchResponse response; stream->Read(&response);) Add(response, jobs);
    EXPECT_TRUE(stream->Finish().ok());
    EXPECT_EQ(jobs.size(), 1u);
    all.push_back(jobs[7]);
    return all;
  }

  // `limit`: single_message_bytes, absent for the default.
  void ExpectForm(v1::VoxelizeRequest request, std::optional<int64_t> limit, const Received& expected) {
    if (limit) request.mutable_delivery()->set_single_message_bytes(*limit);
    const int64_t bytes = int64_t(expected.bytes.size());
    const bool in_one = bytes <= std::min(limit.value_or(kMaxBytes), kMaxBytes) && limit.value_or(kMaxBytes) != 0;
    const std::vector<Received> all = ByEveryCall(request);
    for (size_t i = 0; i < all.size(); ++i) {
      const Received& received = all[i];
      SCOPED_TRACE("call " + std::to_string(i) + ", limit " + (limit ? std::to_string(*limit) : "absent") + ", " +
                   std::to_string(bytes) + " bytes");
      ASSERT_TRUE(received.status.ok()) << received.status.error_message();
      EXPECT_EQ(received.in_one_message, in_one);
      EXPECT_EQ(received.plans, 1);
      EXPECT_EQ(received.headers, 1);
      EXPECT_EQ(received.summaries, 1);
      EXPECT_TRUE(received.bytes == expected.bytes);
      EXPECT_EQ(received.summary.content_sha256(), expected.summary.content_sha256());
      EXPECT_EQ(received.summary.result_bytes(), bytes);
      EXPECT_EQ(received.header.SerializeAsString(), expected.header.SerializeAsString());
      // A job of a batch is not streamed slab by slab.
      EXPECT_EQ(received.plan.grid().SerializeAsString(), expected.plan.grid().SerializeAsString());
      EXPECT_EQ(received.plan.result_bytes(), expected.plan.result_bytes());
      if (!in_one) {
        EXPECT_GE(received.messages, bytes == 0 ? 2 : 3);
      }
    }
  }

  const std::vector<uint8_t> glb_ = TorusGlb(12);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

VoxelizeRequest RequestFor(ResultKind kind, int64_t resolution) {
  VoxelizeRequest request;
  request.grid.resolution = resolution;
  request.result = kind;
  request.targets.resize(2);
  request.targets[1].format = VoxelFormat::kF32;
  request.targets[1].components = 3;
  request.targets[1].blend = Blend::kMax;
  request.targets[1].shader = {"normal", {}};
  return request;
}

TEST_F(ResponseFormsTest, EveryFormHasTheSameBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const int64_t resolution : {12, 100}) {
      SCOPED_TRACE(std::string(Name(kind)) + " " + std::to_string(resolution));
      const v1::VoxelizeRequest request = RequestOf(RequestFor(kind, resolution), glb_);
      const Received expected = Call(*stub_, request);
      ASSERT_TRUE(expected.status.ok()) << expected.status.error_message();
      ASSERT_FALSE(expected.summary.content_sha256().empty());
      const auto bytes = int64_t(expected.bytes.size());
      for (const std::optional<int64_t> limit :
           std::vector<std::optional<int64_t>>{std::nullopt, 0, 1, bytes - 1, bytes, kMaxBytes, int64_t{1} << 40}) {
        ASSERT_NO_FATAL_FAILURE(ExpectForm(request, limit, expected));
      }
    }
  }
}

// Slab by slab, so that a result that does not fit leaves while it is made.
TEST_F(ResponseFormsTest, AResultOfManySlabsToo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stream-above-mb", "0"}));
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    const v1::VoxelizeRequest request = RequestOf(RequestFor(kind, 40), glb_);
    const Received expected = Call(*stub_, request);
    ASSERT_TRUE(expected.status.ok()) << expected.status.error_message();
    EXPECT_LT(expected.plan.slab_depth(), expected.plan.grid().dims().z());
    std::vector<std::optional<int64_t>> limits = {std::nullopt, 0};
    if (kind == ResultKind::kDense) {  // the sizes of lists are estimated, and slabs leave before they are known
      limits.emplace_back(int64_t(expected.bytes.size()) - 1);
      limits.emplace_back(int64_t(expected.bytes.size()));
    }
    for (const std::optional<int64_t> limit : limits) {
      ASSERT_NO_FATAL_FAILURE(ExpectForm(request, limit, expected));
    }
  }
}

TEST_F(ResponseFormsTest, AResultWithoutBytesToo) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = RequestFor(ResultKind::kSparse, 16);
  request.grid.dims = {16, 16, 16};
  request.grid.voxel_size = Vec3d{0.1, 0.1, 0.1};
  request.grid.origin = Vec3d{1e6, 0, 0};  // far from the mesh
  const v1::VoxelizeRequest message = RequestOf(request, glb_);
  const Received expected = Call(*stub_, message);
  ASSERT_TRUE(expected.status.ok()) << expected.status.error_message();
  ASSERT_EQ(expected.bytes.size(), 0u);
  for (const std::optional<int64_t> limit : std::vector<std::optional<int64_t>>{std::nullopt, 0, 1}) {
    ASSERT_NO_FATAL_FAILURE(ExpectForm(message, limit, expected));
  }
}

// A result that is kept, or shared, comes in the form that each request wants.
TEST_F(ResponseFormsTest, AKeptResultComesInEveryForm) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "64MiB"}));
  v1::CreateMeshRequest create;
  create.mutable_mesh()->set_data(glb_.data(), glb_.size());
  v1::Mesh mesh;
  grpc::ClientContext context;
  ASSERT_TRUE(stub_->CreateMesh(&context, create, &mesh).ok());
  for (const int64_t resolution : {12, 100}) {
    const v1::VoxelizeRequest request = StoredRequestOf(RequestFor(ResultKind::kDense, resolution), mesh.name());
    const Received expected = Call(*stub_, request);
    ASSERT_TRUE(expected.status.ok()) << expected.status.error_message();
    EXPECT_FALSE(expected.summary.cached());
    EXPECT_TRUE(Call(*stub_, request).summary.cached());
    for (const std::optional<int64_t> limit : std::vector<std::optional<int64_t>>{std::nullopt, 0, kMaxBytes}) {
      ASSERT_NO_FATAL_FAILURE(ExpectForm(request, limit, expected));
    }
  }
}

TEST_F(ResponseFormsTest, ASizeBelowNoneIsRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeRequest request = RequestOf(SmallRequest(), glb_);
  request.mutable_delivery()->set_single_message_bytes(-1);
  for (const Received& received : ByEveryCall(request)) {
    EXPECT_EQ(received.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_EQ(received.status.error_message(), "single_message_bytes: must not be negative");
  }
}

}  // namespace
}  // namespace voxelpipe::testing
