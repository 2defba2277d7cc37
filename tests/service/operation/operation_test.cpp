// What an operator's options do to what clients see.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/descriptor_database.h>
#include <grpcpp/grpcpp.h>

#include "gmock/gmock.h"
#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/temporary_directory.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/call_settings.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using ::testing::Contains;

class OperationTest : public ::testing::Test {
 protected:
  void Start(const std::vector<std::string>& arguments = {}) {
    server_ = StartServer(arguments, log_path_);
    ASSERT_NE(server_, nullptr);
    channel_ =
        grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());  // its limits are gRPC's own
    stub_ = v1::VoxelizationService::NewStub(channel_);
  }
  // All messages of a VoxelizeUpload call.
  std::vector<v1::VoxelizeResponse> Voxelize(const VoxelizeRequest& request, const std::vector<uint8_t>& mesh,
                                             const CallSettings& settings = {}) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->VoxelizeUpload(&context);
    stream->Write(UploadOf(RequestOf(request, {}, MeshFormat::kGlb, settings)));
    stream->Write(PieceOf(mesh));
    stream->WritesDone();
    std::vector<v1::VoxelizeResponse> responses;
    Received all;
    for (v1::VoxelizeResponse response; stream->Read(&response);) {
      all.Add(response);
      responses.push_back(response);
    }
    const absl::Status status = FromGrpcStatus(stream->Finish());
    EXPECT_TRUE(status.ok()) << status;
    EXPECT_TRUE(all.over);
    return responses;
  }
  std::string Log() {
    server_->Signal(SIGTERM);
    EXPECT_TRUE(server_->Wait().ok());
    std::ifstream file(log_path_);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  const TemporaryDirectory directory_;
  const std::string log_path_ = directory_ / "server.log";
  std::unique_ptr<ServerProcess> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

// Large enough to be loaded by a loader, and not by the worker that plans it.
TEST_F(OperationTest, ThePlanIsTheFirstWord) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 200;
  CallSettings settings;
  settings.single_message_bytes = 0;
  const std::vector<v1::VoxelizeResponse> responses = Voxelize(request, TorusGlb(200), settings);
  ASSERT_GE(responses.size(), 4u);
  EXPECT_TRUE(responses[0].has_plan()) << responses[0].ShortDebugString();
  std::vector<std::string> stages;
  for (const v1::VoxelizeResponse& response : responses) {
    if (response.has_progress()) stages.push_back(response.progress().stage());
    EXPECT_EQ(response.has_plan(), &response == &responses[0]);
  }
  EXPECT_THAT(stages, Contains("load"));
  EXPECT_THAT(stages, Contains("flatten"));
  EXPECT_TRUE(responses.back().has_summary());
}

TEST_F(OperationTest, AFullPieceFitsIntoWhatClientsTakeByDefault) {
  ASSERT_NO_FATAL_FAILURE(Start({"--piece-bytes", "4190208"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 260;
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].blend = Blend::kCount;
  size_t largest = 0;
  for (const v1::VoxelizeResponse& response : Voxelize(request, TorusGlb(20))) {
    largest = std::max(largest, response.ByteSizeLong());
  }
  EXPECT_GT(largest, 4'190'208u);
  EXPECT_LT(largest, 4'194'304u);
}

TEST_F(OperationTest, AConnectionEndsAtItsAge) {
  for (const bool aged : {false, true}) {
    if (aged) {
      ASSERT_NO_FATAL_FAILURE(Start({"--max-connection-age", "300ms"}));
    } else {
      ASSERT_NO_FATAL_FAILURE(Start());
    }
    for (int i = 0; i < 3; ++i) {
      if (i > 0) std::this_thread::sleep_for(std::chrono::milliseconds(500));
      Voxelize(SmallRequest(), TorusGlb(6));
    }
    std::set<std::string> peers;
    std::istringstream log(Log());
    for (std::string line; std::getline(log, line);) {
      const size_t at = line.find(" peer=");
      if (at != std::string::npos) peers.insert(line.substr(at, line.find(' ', at + 1) - at));
    }
    EXPECT_EQ(peers.size(), aged ? 3u : 1u);
    std::filesystem::remove(log_path_);
  }
}

TEST_F(OperationTest, ReflectionV1DescribesEveryService) {
  ASSERT_NO_FATAL_FAILURE(Start());
  namespace reflection = grpc::reflection::v1;
  const auto stub = reflection::ServerReflection::NewStub(channel_);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub->ServerReflectionInfo(&context);
  const auto ask = [&](const reflection::ServerReflectionRequest& request) {
    reflection::ServerReflectionResponse response;
    EXPECT_TRUE(stream->Write(request) && stream->Read(&response));
    return response;
  };
  reflection::ServerReflectionRequest request;
  request.set_host("here");
  request.set_list_services("*");
  const auto list = ask(request);
  EXPECT_EQ(list.original_request().list_services(), "*");
  EXPECT_EQ(list.valid_host(), "here");
  std::vector<std::string> names;
  for (const auto& service : list.list_services_response().service()) names.push_back(service.name());
  for (const char* name : {"voxelpipe.v1.VoxelizationService", "grpc.health.v1.Health",
                           "grpc.reflection.v1.ServerReflection", "grpc.reflection.v1alpha.ServerReflection"}) {
    EXPECT_THAT(names, Contains(name));
    request.set_file_containing_symbol(name);
    const auto files = ask(request);
    ASSERT_GE(files.file_descriptor_response().file_descriptor_proto_size(), 1) << name;
  }
  // A file with all that it imports builds a pool, as clients do.
  request.set_file_containing_symbol("voxelpipe.v1.VoxelizationService.Voxelize");
  const auto files = ask(request);
  google::protobuf::SimpleDescriptorDatabase database;
  for (const std::string& text : files.file_descriptor_response().file_descriptor_proto()) {
    google::protobuf::FileDescriptorProto file;
    ASSERT_TRUE(file.ParseFromString(text));
    database.Add(file);
  }
  google::protobuf::DescriptorPool pool(&database);
  EXPECT_NE(pool.FindMethodByName("voxelpipe.v1.VoxelizationService.Voxelize"), nullptr);
  request.set_file_by_filename("voxelpipe/v1/types.proto");
  EXPECT_EQ(ask(request).file_descriptor_response().file_descriptor_proto_size(), 1);
  request.set_file_by_filename("/etc/passwd");
  EXPECT_EQ(ask(request).error_response().error_code(), int(grpc::StatusCode::NOT_FOUND));
  request.set_file_containing_symbol("no.such.Symbol");
  EXPECT_EQ(ask(request).error_response().error_code(), int(grpc::StatusCode::NOT_FOUND));
  request.clear_message_request();
  EXPECT_EQ(ask(request).error_response().error_code(), int(grpc::StatusCode::INVALID_ARGUMENT));
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(OperationTest, WithoutReflectionThereIsNone) {
  ASSERT_NO_FATAL_FAILURE(Start({"--reflection", "false"}));
  const auto stub = grpc::reflection::v1::ServerReflection::NewStub(channel_);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const auto stream = stub->ServerReflectionInfo(&context);
  stream->WritesDone();
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNIMPLEMENTED);
}

TEST_F(OperationTest, TheConfigCheckRefusesWhatTheTableForbids) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"--piece-bytes", "4MiB"},
                                                    {"--zstd-level", "20"},
                                                    {"--max-calls", "0"},
                                                    {"--reload-interval-ms", "1"},
                                                    {"--max-file-bytes", "2GiB", "--max-upload-bytes", "1GiB"},
                                                    {"--tls-client-names", "true"}}) {
    std::vector<std::string> all = arguments;
    all.push_back("--check-config");
    const auto run = RunVoxelpiped(all);
    ASSERT_TRUE(run.ok()) << run.status();
    EXPECT_EQ(run->exit_code, 2) << arguments[0];
  }
  const auto run = RunVoxelpiped({"--check-config"});
  ASSERT_TRUE(run.ok()) << run.status();
  EXPECT_EQ(run->exit_code, 0);
}

}  // namespace
}  // namespace voxelpipe::testing
