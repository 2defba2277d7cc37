// POST /file: results as files, equal to those of the command line.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/support/status.h>

#include "absl/strings/escaping.h"
#include "encode/format_registry.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/process_facts.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/web_fixture.h"
#include "unit/cli/cli_runner.h"

namespace voxelpipe::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::AnyOf;
using ::testing::HasSubstr;

std::string Contents(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

class FileTest : public WebServerTest {
 protected:
  void SetUp() override {
    // The server inherits it, and must leave nothing there.
    fs::create_directories(folder_ + "/tmp");
    setenv("TMPDIR", (folder_ + "/tmp").c_str(), 1);
    std::ofstream(folder_ + "/torus.glb", std::ios::binary)
        .write(reinterpret_cast<const char*>(torus_.data()), std::streamsize(torus_.size()));
  }
  void TearDown() override { unsetenv("TMPDIR"); }

  HttpReply FileOf(const std::string& format, const std::string& message, HttpHeaders headers = {}) {
    headers.emplace_back("Content-Type", "application/x-protobuf");
    return Fetch(web_, "POST", "/file?format=" + format, headers, message);
  }
  HttpReply FileOf(const std::string& format, const VoxelizeRequest& request) {
    return FileOf(format, Message(torus_, request).SerializeAsString());
  }
  // The file that the command line writes with the same options, in `folder_`.
  std::string OfCommandLine(const std::string& name, std::vector<std::string> options) {
    const std::string path = folder_ + "/" + name;
    options.insert(options.begin(), {"voxelize", folder_ + "/torus.glb", "-o", path});
    const CliOutcome outcome = RunCli(options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return path;
  }
  static v1::Summary SummaryOf(const HttpReply& reply) {
    std::string bytes;
    v1::Summary summary;
    EXPECT_TRUE(absl::Base64Unescape(reply.Header("voxelpipe-summary-bin"), &bytes) && summary.ParseFromString(bytes))
        << reply.Header("voxelpipe-summary-bin");
    return summary;
  }
  bool NothingIsLeft() const {
    return BecomesTrue([&] { return fs::is_empty(folder_ + "/tmp"); });
  }
  // Unpacks an archive of the server below `folder_`.
  std::string Unpacked(const std::string& archive) {
    std::ofstream(folder_ + "/got.zip", std::ios::binary) << archive;
    const std::string to = folder_ + "/got";
    fs::create_directories(to);
    EXPECT_EQ(std::system(("python3 -m zipfile -e '" + folder_ + "/got.zip' '" + to + "'").c_str()), 0);
    return to;
  }

  const std::vector<uint8_t> torus_ = TorusGlb(16);
};

TEST_F(FileTest, EqualsTheCommandLines) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 64;
  for (const char* const format : {"npy", "npz", "vti", "nrrd", "seg.nrrd", "nii.gz", "png"}) {
    const HttpReply reply = FileOf(format, request);
    ASSERT_EQ(reply.code, 200) << format << ": " << reply.body;
    EXPECT_TRUE(reply.complete);
    const std::string name = std::string("result.") + format;
    EXPECT_EQ(reply.Header("content-disposition"), "attachment; filename=\"" + name + "\"");
    EXPECT_TRUE(reply.body == Contents(OfCommandLine(name, {"--resolution", "64", "--target", "bit:or"}))) << format;
    EXPECT_GT(reply.body.size(), 300u);
  }
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(FileTest, WhatTheRequestLeavesOpenFollowsTheFormatAsInTheCommandLine) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 24;
  request.fill = Fill::kParity;
  auto message = Message(torus_, request);
  message.mutable_spec()->clear_targets();
  message.mutable_spec()->clear_result();
  for (const char* const format : {"npy", "seg.nrrd", "png", "vox", "glb"}) {
    const HttpReply reply = FileOf(format, message.SerializeAsString());
    ASSERT_EQ(reply.code, 200) << format << ": " << reply.body;
    const std::string name = std::string("open.") + format;
    EXPECT_TRUE(reply.body == Contents(OfCommandLine(name, {"--resolution", "24", "--fill", "parity"}))) << format;
  }
}

TEST_F(FileTest, OfManyPieces) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 160;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"barycentric", {}};
  const HttpReply reply = FileOf("npy", request);
  ASSERT_EQ(reply.code, 200) << reply.body;
  EXPECT_GT(reply.body.size(), 4u << 20) << "more than a message holds";
  EXPECT_TRUE(reply.body == Contents(OfCommandLine(
                                "result.npy", {"--resolution", "160", "--target", "f32x1:max:shader=barycentric"})));
}

TEST_F(FileTest, SeveralFilesComeAsAnArchive) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 32;
  for (const std::string format : {"raw", "zarr"}) {
    const HttpReply reply = FileOf(format, request);
    ASSERT_EQ(reply.code, 200) << reply.body;
    EXPECT_THAT(reply.Header("content-disposition"), HasSubstr("\"result." + format + ".zip\""));
    const std::string got = Unpacked(reply.body);
    const fs::path want = fs::path(folder_) / "want";
    fs::create_directories(want);
    OfCommandLine("want/result." + format, {"--resolution", "32"});
    size_t files = 0;
    for (const auto& each : fs::recursive_directory_iterator(want)) {
      if (!each.is_regular_file()) continue;
      ++files;
      const fs::path name = fs::relative(each.path(), want);
      EXPECT_TRUE(Contents(each.path()) == Contents(fs::path(got) / name)) << name;
    }
    EXPECT_GE(files, 2u);
    fs::remove_all(want);
    fs::remove_all(got);
  }
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(FileTest, RefusesWhatItCannotMake) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string message = Message(torus_, SmallRequest()).SerializeAsString();
  EXPECT_THAT(FileOf("doc", message).body, HasSubstr("'doc' is not one of npy, npz"));
  EXPECT_EQ(FileOf("", message).code, 400);
  EXPECT_EQ(Fetch(web_, "POST", "/file", {{"Content-Type", "application/x-protobuf"}}, message).code, 400);
  EXPECT_EQ(
      Fetch(web_, "POST", "/file?format=npy", {{"Content-Type", "application/x-www-form-urlencoded"}}, message).code,
      415)
      << "a type that forms can send";
  EXPECT_EQ(FileOf("npy", "\x0a\x7f").code, 400) << "no message";
  const HttpReply no_mesh = FileOf("npy", Message({1, 2, 3}, SmallRequest()).SerializeAsString());
  EXPECT_EQ(no_mesh.code, 400);
  EXPECT_EQ(no_mesh.Header("grpc-status"), std::to_string(int(grpc::StatusCode::INVALID_ARGUMENT)));
  VoxelizeRequest sparse = SmallRequest();
  sparse.result = ResultKind::kSparse;
  EXPECT_THAT(FileOf("npy", sparse).body, HasSubstr(".npy holds dense results"));
  v1::VoxelizeRequest compressed = Message(torus_, SmallRequest());
  compressed.mutable_delivery()->set_compression(v1::COMPRESSION_ZSTD);
  EXPECT_THAT(FileOf("npy", compressed.SerializeAsString()).body, HasSubstr("compression: a file needs NONE"));
  EXPECT_EQ(FileOf("npz", sparse).code, 200);
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(FileTest, WarningsAreHeaders) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string bare =
      R"({"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],
         "buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,)"
      "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}],"
      R"("bufferViews":[{"buffer":0,"byteLength":36}],
         "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]})";
  v1::VoxelizeRequest message;
  message.mutable_mesh()->mutable_bytes()->set_data(bare);
  const HttpReply reply = FileOf("npy", message.SerializeAsString());
  EXPECT_EQ(reply.code, 200) << reply.body;
  EXPECT_THAT(reply.Header("voxelpipe-warning"), HasSubstr("scene"));
  const v1::Summary summary = SummaryOf(reply);
  ASSERT_EQ(summary.warnings_size(), 1);
  EXPECT_EQ(summary.warnings(0).code(), v1::WARNING_CODE_NO_SCENE);
  EXPECT_EQ(summary.warnings_left_out(), 0);
}

TEST_F(FileTest, TheSummaryOfTheCallIsAHeader) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const HttpReply reply = FileOf("npy", SmallRequest());
  ASSERT_EQ(reply.code, 200) << reply.body;
  const v1::Summary summary = SummaryOf(reply);
  EXPECT_EQ(summary.stats().triangles(), 512);
  EXPECT_GT(summary.stats().occupied(), 100);
  EXPECT_GT(summary.stats().voxelize_time().seconds() + summary.stats().voxelize_time().nanos(), 0);
  EXPECT_EQ(summary.stats().backend(), v1::BACKEND_CPU);
  EXPECT_EQ(summary.warnings_size(), 0);
}

TEST_F(FileTest, OfAStoredMesh) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeRequest request = Message(torus_, SmallRequest());
  const HttpReply of_bytes = FileOf("npy", request.SerializeAsString());
  v1::CreateMeshRequest create;
  *create.mutable_mesh() = request.mesh().bytes();
  v1::Mesh mesh;
  const WebReplyOfCall created = CallWeb(web_, "CreateMesh", create.SerializeAsString());
  ASSERT_TRUE(created.messages.size() == 1 && mesh.ParseFromString(created.messages[0])) << created.trailers;
  request.mutable_mesh()->mutable_stored()->set_name(mesh.name());
  const HttpReply reply = FileOf("npy", request.SerializeAsString());
  EXPECT_EQ(reply.code, 200) << reply.body;
  EXPECT_TRUE(reply.body == of_bytes.body);
  v1::PlacedMesh& placed = *request.mutable_mesh()->mutable_placed()->add_meshes();
  placed.set_mesh(mesh.name());
  EXPECT_TRUE(FileOf("npy", request.SerializeAsString()).body == of_bytes.body) << "placed where it is";
  placed.set_label(0);
  EXPECT_EQ(FileOf("npy", request.SerializeAsString()).code, 400);
  request.mutable_mesh()->mutable_stored()->set_name("meshes/" + std::string(64, 'a'));
  const HttpReply missing = FileOf("npy", request.SerializeAsString());
  EXPECT_EQ(missing.code, 404);
  EXPECT_EQ(missing.Header("grpc-status"), std::to_string(int(grpc::StatusCode::NOT_FOUND)));
}

TEST_F(FileTest, WhatAFormatDoesNotHoldIsAHeaderAndFailsAStrictRequest) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 24;
  request.result = ResultKind::kSparse;
  EXPECT_EQ(FileOf("vox", request).Header("voxelpipe-warning"), "");
  request.targets.push_back(request.targets[0]);  // of which a .vox shows one
  const HttpReply reply = FileOf("vox", request);
  EXPECT_EQ(reply.code, 200) << reply.body;
  EXPECT_THAT(reply.Header("voxelpipe-warning"), HasSubstr("not every target"));
  EXPECT_EQ(SummaryOf(reply).warnings(0).code(), v1::WARNING_CODE_NOT_KEPT);
  request.strict = true;
  const HttpReply refused = FileOf("vox", request);
  EXPECT_EQ(refused.code, 400) << refused.body;
  EXPECT_THAT(refused.body, HasSubstr("not every target"));
}

TEST_F(FileTest, FilesBeyondTheLimitAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start({"--export-bytes", "100000"}));
  VoxelizeRequest request = SmallRequest();
  EXPECT_EQ(FileOf("npy", request).code, 200);
  request.grid.resolution = 256;
  HttpReply reply = FileOf("raw", request);
  EXPECT_EQ(reply.code, 429) << "the result alone is larger";
  EXPECT_THAT(reply.body, HasSubstr("--export-bytes"));
  request.grid.resolution = 80;
  reply = FileOf("npy", request);
  EXPECT_EQ(reply.code, 429) << "bits fit, bytes do not";
  EXPECT_EQ(FileOf("npy", SmallRequest()).code, 200) << "nothing of it stays charged";
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(FileTest, AClientThatHangsUpEndsItsFile) {
  ASSERT_NO_FATAL_FAILURE(Start({"--threads", "1", "--workers", "1"}));
  {
    const WebConnection connection(web_);
    ASSERT_TRUE(
        connection.Send(HttpRequest(web_, "POST", "/file?format=npy", {{"Content-Type", "application/x-protobuf"}},
                                    Message(LargeTrianglesGlb(20'000), SlowRequest()).SerializeAsString())));
    ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 1; }));
  }
  EXPECT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 0; }));
  EXPECT_TRUE(NothingIsLeft());
}

// A few voxels in a grid of 1024^3: what a file takes must follow the result, not the grid.
VoxelizeRequest FewVoxelsOfMany() {
  VoxelizeRequest request;
  request.grid.dims = {{1024, 1024, 1024}};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.grid.origin = Vec3d{0, 0, 0};
  request.result = ResultKind::kSparse;
  return request;
}

TEST_F(FileTest, EveryFormatFitsInTheLeastMemoryThatItIsMadeIn) {
  constexpr uint64_t kMinLimitBytes = 8 << 20, kMaxLimitBytes = 128 << 20;
  constexpr uint64_t kSlackBytes = 48 << 20;  // of threads and libraries, which the first request brings
  for (const OutputFormat& format : OutputFormats()) {
    if (!format.sparse) continue;
    bool made = false;
    for (uint64_t limit_bytes = kMinLimitBytes; !made && limit_bytes < kMaxLimitBytes; limit_bytes += limit_bytes / 2) {
      ASSERT_NO_FATAL_FAILURE(Start({"--max-working-bytes", std::to_string(limit_bytes)}));
      const uint64_t before_bytes = ReadProcessFacts(server_->pid()).resident_bytes;
      const HttpReply reply = FileOf(std::string(format.name), FewVoxelsOfMany());
      EXPECT_THAT(reply.code, AnyOf(200, 429)) << format.name << ": " << reply.body;
      made = reply.code == 200;
      if (!IsSanitized(server_->pid())) {
        EXPECT_LE(ReadProcessFacts(server_->pid()).peak_bytes, before_bytes + limit_bytes + kSlackBytes)
            << format.name << " with " << limit_bytes << " bytes: " << reply.code;
      }
      EXPECT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0; }));
    }
    EXPECT_TRUE(made) << format.name;
  }
  EXPECT_TRUE(NothingIsLeft());
}

TEST_F(FileTest, EveryFormatEndsWithItsClientAtTenMoments) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 192;
  const std::string message = Message(torus_, request).SerializeAsString();
  constexpr std::chrono::milliseconds kStep{8};
  for (const OutputFormat& format : OutputFormats()) {
    for (int moment = 0; moment < 10; ++moment) {
      const WebConnection connection(web_);
      ASSERT_TRUE(connection.Send(HttpRequest(web_, "POST", "/file?format=" + std::string(format.name),
                                              {{"Content-Type", "application/x-protobuf"}}, message)));
      std::this_thread::sleep_for(moment * kStep);
    }
    EXPECT_TRUE(BecomesTrue([&] {
      return Sample("voxelpipe_running_jobs") == 0 && Sample("voxelpipe_memory_bytes{budget=\"working\"}") == 0;
    })) << format.name;
    EXPECT_TRUE(NothingIsLeft()) << format.name;
  }
  EXPECT_EQ(FileOf("npz", request).code, 200);
}

TEST_F(FileTest, IsMadeByTheJobOfTheCall) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 64;
  const HttpReply reply = FileOf("npy", request);
  ASSERT_EQ(reply.code, 200) << reply.body;
  EXPECT_EQ(Sample("voxelpipe_jobs_total{code=\"OK\"}"), 1);
  EXPECT_GE(Sample("voxelpipe_sent_bytes_total"), double(reply.body.size()));
  EXPECT_LT(Sample("voxelpipe_sent_bytes_total"), double(reply.body.size()) + 10'000) << "no pieces beside the file";
}

}  // namespace
}  // namespace voxelpipe::testing
