// What tests of stored meshes share: a server, a client of it, a mesh.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "load/loader.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {

class MeshStoreTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    stub_ = StubOf(*server_);
  }

  StoredMesh Upload(const std::vector<uint8_t>& bytes) {
    const JobContext job;
    const absl::StatusOr<StoredMesh> mesh = client_->UploadMesh(bytes, MeshFormat::kAuto, job);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.value_or(StoredMesh{});
  }

  // What the server says to an upload of these messages.
  absl::Status UploadRaw(const std::vector<v1::UploadMeshRequest>& messages, v1::Mesh* response = nullptr) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    v1::Mesh answer;
    const auto stream = stub_->UploadMesh(&context, response == nullptr ? &answer : response);
    for (const v1::UploadMeshRequest& message : messages) {
      if (!stream->Write(message)) break;
    }
    stream->WritesDone();
    return FromGrpcStatus(stream->Finish());
  }

  std::string HashOfFile(const std::vector<uint8_t>& bytes, const VoxelizeRequest& request) {
    const JobContext job;
    const auto result = client_->Voxelize(bytes, MeshFormat::kAuto, request, job);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? result->content_sha256 : "";
  }
  std::string HashOfStored(const std::string& name, const VoxelizeRequest& request,
                           std::span<const float> positions = {}) {
    const JobContext job;
    const auto result = client_->VoxelizeStored(name, request, job, positions);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? result->content_sha256 : "";
  }

  const std::vector<uint8_t> glb_ = TorusGlb(12);
  const JobContext job_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

// Shaders that read nothing, textures of one kind, and textures of another; with a fill, and as buckets.
inline std::vector<VoxelizeRequest> Requests() {
  std::vector<VoxelizeRequest> requests(4, SmallRequest());
  for (size_t i = 1; i < requests.size(); ++i) {
    TargetSpec& target = requests[i].targets[0];
    target.format = VoxelFormat::kF32;
    target.components = 3;
    target.blend = Blend::kReplace;
    target.shader = {i == 2 ? "emissive" : "base_color", {}};
  }
  requests[0].fill = Fill::kParity;
  requests[3].result = ResultKind::kBuckets;
  return requests;
}

}  // namespace voxelpipe::testing
