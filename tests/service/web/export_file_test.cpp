// ExportFile: results as files over gRPC, the same as those of POST /file.
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/checksum/crc32c.h"
#include "encode/format_registry.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/web_fixture.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// A whole call.
struct Exported {
  grpc::Status status;
  v1::FileInfo file;
  std::optional<v1::Summary> summary;  // absent: there is no file
  std::string bytes;
  int messages = 0;
};

class ExportFileTest : public WebServerTest {
 protected:
  void SetUp() override {
    // The server inherits it, and must leave nothing there.
    fs::create_directories(folder_ + "/tmp");
    setenv("TMPDIR", (folder_ + "/tmp").c_str(), 1);
  }
  void TearDown() override { unsetenv("TMPDIR"); }

  void Start(std::vector<std::string> arguments = {}) {
    ASSERT_NO_FATAL_FAILURE(WebServerTest::Start(std::move(arguments)));
    stub_ = StubOf(*server_);
  }

  Exported Export(const std::string& format, const v1::VoxelizeRequest& request,
                  std::chrono::milliseconds timeout = kPatience) {
    v1::ExportFileRequest message;
    *message.mutable_request() = request;
    message.set_format(format);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout);
    const auto stream = stub_->ExportFile(&context, message);
    Exported out;
    for (v1::FileChunk chunk; stream->Read(&chunk); ++out.messages) {
      EXPECT_EQ(chunk.has_file(), out.messages == 0) << "the file comes first, once";
      EXPECT_FALSE(out.summary) << "the summary is last";
      if (chunk.has_file()) out.file = chunk.file();
      const std::string& data = chunk.data();
      EXPECT_EQ(chunk.crc32c(), Crc32c({reinterpret_cast<const uint8_t*>(data.data()), data.size()}));
      out.bytes += data;
      if (chunk.has_summary()) out.summary = chunk.summary().summary();
    }
    out.status = stream->Finish();
    if (out.summary) {
      EXPECT_EQ(uint64_t(out.file.bytes()), out.bytes.size());
    }
    return out;
  }
  HttpReply Download(const std::string& format, const v1::VoxelizeRequest& request) {
    return Fetch(web_, "POST", "/file?format=" + format, {{"Content-Type", "application/x-protobuf"}},
                 request.SerializeAsString());
  }
  std::string Store(const std::vector<uint8_t>& file) {
    v1::CreateMeshRequest message;
    message.mutable_mesh()->set_data(file.data(), file.size());
    v1::Mesh mesh;
    grpc::ClientContext context;
    EXPECT_TRUE(stub_->CreateMesh(&context, message, &mesh).ok());
    return mesh.name();
  }
  double Runs() { return Sample("voxelpipe_job_seconds_count"); }
  bool NothingIsLeft() {
    return BecomesTrue([&] { return fs::is_empty(folder_ + "/tmp"); });
  }

  const std::vector<uint8_t> torus_ = TorusGlb(12);
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

TEST_F(ExportFileTest, EveryFormatEqualsTheDownload) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const v1::VoxelizeRequest request = RequestOf(SmallRequest(), torus_);
  v1::GetServerInfoResponse info;
  grpc::ClientContext context;
  ASSERT_TRUE(stub_->GetServerInfo(&context, {}, &info).ok());
  ASSERT_EQ(size_t(info.formats_size()), OutputFormats().size());
  for (const v1::ExportFormat& format : info.formats()) {
    SCOPED_TRACE(format.name());
    const Exported exported = Export(format.name(), request);
    ASSERT_TRUE(exported.status.ok()) << exported.status.error_message();
    ASSERT_TRUE(exported.summary);
    EXPECT_GT(exported.summary->stats().occupied(), 0);
    EXPECT_EQ(exported.file.name().ends_with(".zip"), format.archive() || format.name() == "raw")
        << exported.file.name();
    const HttpReply download = Download(format.name(), request);
    ASSERT_EQ(download.code, 200) << download.body;
    EXPECT_TRUE(exported.bytes == download.body);
  }
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(ExportFileTest, ALargeFileComesInPieces) {
  ASSERT_NO_FATAL_FAILURE(Start({"--piece-bytes", "65536"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 128;
  const v1::VoxelizeRequest message = RequestOf(request, torus_);
  const Exported exported = Export("npy", message);
  ASSERT_TRUE(exported.status.ok()) << exported.status.error_message();
  EXPECT_GT(exported.messages, 4);
  ASSERT_TRUE(exported.summary);
  EXPECT_TRUE(exported.bytes == Download("npy", message).body);
}

TEST_F(ExportFileTest, WhatIsNoFileIsRefusedByField) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto refused = [&](const std::string& format, const v1::VoxelizeRequest& request, const char* text) {
    const Exported exported = Export(format, request);
    EXPECT_EQ(exported.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << text;
    EXPECT_THAT(exported.status.error_message(), HasSubstr(text));
    EXPECT_FALSE(exported.summary);
    EXPECT_EQ(exported.messages, 0);
  };
  v1::VoxelizeRequest request = RequestOf(SmallRequest(), torus_);
  refused("doc", request, "format: 'doc' is not one of npy, npz");
  refused("", request, "format: '' is not one of npy, npz");
  request.mutable_delivery()->set_compression(v1::COMPRESSION_ZSTD);
  refused("npy", request, "compression: a file needs NONE");
  request = RequestOf(SmallRequest(), torus_);
  request.mutable_spec()->set_result(v1::RESULT_KIND_BUCKETS);
  refused("nrrd", request, "buckets");
  request = StoredRequestOf(SmallRequest(), "meshes/7");
  refused("npy", request, "mesh.stored.name: must be meshes/");
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(ExportFileTest, AnEqualResultIsRunOnce) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeRequest request;
  request.mutable_mesh()->mutable_stored()->set_name(Store(torus_));
  request.mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(40);
  std::vector<Exported> all;
  for (const char* format : {"merged.glb", "vox", "glb", "merged.glb"}) {
    all.push_back(Export(format, request));
    ASSERT_TRUE(all.back().summary) << format << ": " << all.back().status.error_message();
    EXPECT_EQ(all.back().summary->cached(), all.size() > 1) << format;
    EXPECT_EQ(all.back().summary->stats().occupied(), all.front().summary->stats().occupied()) << format;
  }
  EXPECT_TRUE(all.front().bytes == all.back().bytes);
  EXPECT_EQ(Runs(), 1);
  EXPECT_TRUE(Download("vox", request).body == all[1].bytes);
  EXPECT_EQ(Runs(), 1) << "a download over HTTP is the same";
  request.mutable_spec()->set_coverage(v1::COVERAGE_THIN);
  EXPECT_FALSE(Export("vox", request).summary->cached());
  EXPECT_EQ(Runs(), 2);
}

TEST_F(ExportFileTest, ACachedResultServesCallsAndFiles) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const v1::VoxelizeRequest request = StoredRequestOf(SmallRequest(), Store(torus_));
  const Received first = Call(*stub_, request);
  ASSERT_TRUE(first.status.ok());
  const Exported exported = Export("raw", request);
  ASSERT_TRUE(exported.summary) << exported.status.error_message();
  EXPECT_TRUE(exported.summary->cached());
  v1::VoxelizeRequest other = request;
  other.mutable_spec()->set_coverage(v1::COVERAGE_CENTER);
  EXPECT_FALSE(Export("raw", other).summary->cached());
  const Received second = Call(*stub_, other);
  ASSERT_TRUE(second.status.ok());
  EXPECT_TRUE(second.summary.cached()) << "what an export made serves a call";
  EXPECT_EQ(Runs(), 2);
}

TEST_F(ExportFileTest, WithoutACacheEachIsRun) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "0"}));
  const v1::VoxelizeRequest request = StoredRequestOf(SmallRequest(), Store(torus_));
  for (int i = 1; i <= 2; ++i) {
    const Exported exported = Export("npz", request);
    ASSERT_TRUE(exported.summary) << exported.status.error_message();
    EXPECT_FALSE(exported.summary->cached());
    EXPECT_EQ(Runs(), i);
  }
}

TEST_F(ExportFileTest, AFailureInTheMiddleIsNoFile) {
  ASSERT_NO_FATAL_FAILURE(Start({"--export-bytes", "100000"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 80;  // bits fit, the bytes of the file do not
  const Exported exported = Export("npy", RequestOf(request, torus_));
  EXPECT_EQ(exported.status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(exported.status.error_message(), HasSubstr("--export-bytes"));
  EXPECT_FALSE(exported.summary);
  EXPECT_TRUE(Export("npy", RequestOf(SmallRequest(), torus_)).summary) << "nothing of it stays charged";
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(ExportFileTest, EndsWithItsCall) {
  ASSERT_NO_FATAL_FAILURE(Start({"--threads", "1", "--workers", "1"}));
  const Exported exported =
      Export("npy", RequestOf(SlowRequest(), LargeTrianglesGlb(20'000)), std::chrono::milliseconds(300));
  EXPECT_EQ(exported.status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_FALSE(exported.summary);
  EXPECT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 0; }));
  EXPECT_TRUE(NothingIsLeft());
}

// The budget of files is small enough that a charge that is not given back would show.
TEST_F(ExportFileTest, AClientThatReadsNothingCostsOneFile) {
  ASSERT_NO_FATAL_FAILURE(Start({"--export-bytes", "8MiB", "--stall-timeout-ms", "500"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 200;
  v1::ExportFileRequest message;
  *message.mutable_request() = RequestOf(request, torus_);
  message.set_format("npy");
  {
    grpc::ClientContext context;
    const auto stream = stub_->ExportFile(&context, message);
    EXPECT_TRUE(BecomesTrue([&] { return Runs() == 1; }));
    EXPECT_TRUE(NothingIsLeft()) << "the file has no name any more while it waits for its reader";
    context.TryCancel();
    stream->Finish().ok();
  }
  request.grid.resolution = 180;
  EXPECT_TRUE(BecomesTrue([&] { return Export("npy", RequestOf(request, torus_)).summary.has_value(); }));
}

}  // namespace
}  // namespace voxelpipe::testing
