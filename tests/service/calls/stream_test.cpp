// Results that leave the server slab by slab while they are made.
#include <algorithm>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "pipeline/voxelize.h"
#include "service/support/background_call.h"
#include "service/support/messages.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

// The server works in slabs of eight layers, whatever the grid.
class StreamTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn", "--stream-above-mb", "0", "--workers", "1"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
  }

  // The one worker is free again: a call comes through.
  void ExpectFree() {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + kPatience);
    VoxelizeRequest small;
    small.grid.resolution = 8;
    const absl::Status status = client_->Voxelize(glb_, MeshFormat::kGlb, small, job).status();
    EXPECT_TRUE(status.ok()) << status;
  }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

// 64 MiB: far more than all the buffers between us.
VoxelizeRequest Large() {
  VoxelizeRequest request;
  request.grid.dims = {256, 256, 256};
  request.grid.voxel_size = Vec3d{0.02, 0.02, 0.02};
  request.grid.origin = Vec3d{0, 0, 0};
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kReplace;
  return request;
}

// Counts what comes; `on_write` is called with the bytes so far.
struct CountingSink : ResultSink {
  absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
  absl::Status Write(size_t, std::span<const uint8_t> bytes) override {
    count += bytes.size();
    return on_write ? on_write(count) : absl::OkStatus();
  }
  uint64_t count = 0;
  std::function<absl::Status(uint64_t)> on_write;
};

TEST_F(StreamTest, SlabsAddUpToTheSameBytes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const absl::StatusOr<Scene> scene = LoadScene(glb_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  const JobContext job;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood}) {
        if (kind == ResultKind::kBuckets && fill != Fill::kNone) continue;
        SCOPED_TRACE(std::string(Name(kind)) + " " + std::string(Name(fill)));
        VoxelizeRequest request;
        request.grid.resolution = 61;
        request.grid.fit = GridFit::kCube;
        request.result = kind;
        request.layout = layout;
        request.fill = fill;
        request.targets.resize(2);
        request.targets[1].format = VoxelFormat::kU16;
        request.targets[1].components = 3;
        request.targets[1].blend = Blend::kAverage;
        request.targets[1].shader = {"barycentric", {}};
        request.targets[1].scale = 1000;
        const absl::StatusOr<VoxelizeResult> here = Voxelize(*mesh, request, {job});
        ASSERT_TRUE(here.ok()) << here.status();
        Plan plan;
        const auto there = client_->Voxelize(glb_, MeshFormat::kGlb, request, job, [&](const Plan& p) { plan = p; });
        ASSERT_TRUE(there.ok()) << there.status();
        EXPECT_LT(plan.slab_depth, 61) << "one slab would prove nothing";
        const auto a = ArraysOf(*here), b = ArraysOf(there->result);
        ASSERT_EQ(a.size(), b.size());
        for (size_t i = 0; i < a.size(); ++i) {
          EXPECT_TRUE(std::equal(a[i].begin(), a[i].end(), b[i].begin(), b[i].end())) << "array " << i;
        }
        EXPECT_EQ(there->stats.occupied, here->stats.occupied);
        EXPECT_EQ(there->stats.odd_columns, here->stats.odd_columns);
      }
    }
  }
}

TEST_F(StreamTest, AnEstimateKnowsTheSlabs) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  Plan told;
  CountingSink sink;
  const auto run =
      client_->VoxelizeTo(glb_, MeshFormat::kGlb, Large(), job, sink, [&](const Plan& plan) { told = plan; });
  ASSERT_TRUE(run.ok()) << run.status();
  EXPECT_EQ(sink.count, uint64_t{64} << 20);
  EXPECT_EQ(told.result_bytes, sink.count);
  EXPECT_LT(told.peak_bytes, sink.count / 2) << "the result is never held as a whole";
  const auto estimate = client_->Estimate(glb_, MeshFormat::kGlb, Large(), job);
  ASSERT_TRUE(estimate.ok()) << estimate.status();
  EXPECT_EQ(estimate->plan.peak_bytes, told.peak_bytes);
  EXPECT_EQ(estimate->plan.slab_depth, told.slab_depth);
}

TEST_F(StreamTest, CancelInTheMiddleFreesTheWorker) {
  ASSERT_NO_FATAL_FAILURE(Start());
  JobContext job;
  CountingSink sink;
  sink.on_write = [&](uint64_t) { return job.Cancel(), absl::OkStatus(); };
  const absl::Status status = client_->VoxelizeTo(glb_, MeshFormat::kGlb, Large(), job, sink).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled) << status;
  EXPECT_LT(sink.count, uint64_t{64} << 20);
  ExpectFree();
}

TEST_F(StreamTest, TheSinksErrorEndsTheCallOnBothSides) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  CountingSink sink;
  sink.on_write = [](uint64_t) { return absl::DataLossError("the disk is full"); };
  EXPECT_EQ(client_->VoxelizeTo(glb_, MeshFormat::kGlb, Large(), job, sink).status(),
            absl::DataLossError("the disk is full"));
  ExpectFree();
}

TEST_F(StreamTest, ASlowReaderGetsEverything) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const JobContext job;
  CountingSink sink;
  sink.on_write = [](uint64_t count) {
    if (count < 16 << 20) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return absl::OkStatus();
  };
  const auto run = client_->VoxelizeTo(glb_, MeshFormat::kGlb, Large(), job, sink);
  ASSERT_TRUE(run.ok()) << run.status();
  EXPECT_EQ(sink.count, uint64_t{64} << 20);
}

// Asks for a large result and reads no more than its plan.
class NonReader {
 public:
  NonReader(const ServerProcess& server, const std::vector<uint8_t>& glb, std::chrono::milliseconds deadline)
      : stub_(StubOf(server)) {
    context_.set_deadline(std::chrono::system_clock::now() + deadline);
    stream_ = stub_->VoxelizeUpload(&context_);
    stream_->Write(UploadOf(RequestOf(Large())));
    stream_->Write(PieceOf(glb));
    stream_->WritesDone();
    v1::VoxelizeResponse response;
    bool more = true;
    while (more && !response.has_plan()) more = stream_->Read(&response);
    EXPECT_TRUE(more);
  }
  grpc::StatusCode Finish() {
    v1::VoxelizeResponse response;
    while (stream_->Read(&response)) {}
    return stream_->Finish().error_code();
  }
  void Cancel() { context_.TryCancel(); }

 private:
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::VoxelizeUploadRequest, v1::VoxelizeResponse>> stream_;
};

TEST_F(StreamTest, AClientThatStopsReadingIsLetGo) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stall-timeout-ms", "300"}));
  NonReader reader(*server_, glb_, kPatience);
  ExpectFree();  // while it still does not read
  EXPECT_NE(reader.Finish(), grpc::StatusCode::OK);
}

// A result in memory needs no worker any more, but its memory.
TEST_F(StreamTest, AClientThatStopsReadingAResultInMemoryIsLetGo) {
  server_ = StartServer({"--log-level", "warn", "--stall-timeout-ms", "3000", "--max-working-bytes", "120M"});
  ASSERT_NE(server_, nullptr);
  client_ = ConnectTo(*server_);
  ASSERT_NE(client_, nullptr);
  NonReader reader(*server_, glb_, kPatience);
  // More than one job needs, less than two results: 64 MiB are held for the one that does not read, so this one waits
  // until they are given back.
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + kPatience);
  CountingSink sink;
  const absl::Status status = client_->VoxelizeTo(glb_, MeshFormat::kGlb, Large(), job, sink).status();
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_NE(reader.Finish(), grpc::StatusCode::OK);
}

TEST_F(StreamTest, ADeadlineWakesAWaitingWorker) {
  ASSERT_NO_FATAL_FAILURE(Start());
  NonReader reader(*server_, glb_, std::chrono::milliseconds(700));
  ExpectFree();
  EXPECT_EQ(reader.Finish(), grpc::StatusCode::DEADLINE_EXCEEDED);
}

TEST_F(StreamTest, AClientThatIsGoneLeavesNoWaitingWorker) {
  ASSERT_NO_FATAL_FAILURE(Start());
  NonReader reader(*server_, glb_, kPatience);
  reader.Cancel();
  ExpectFree();
  EXPECT_EQ(reader.Finish(), grpc::StatusCode::CANCELLED);
}

}  // namespace
}  // namespace voxelpipe::testing
