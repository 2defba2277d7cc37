// What tests of several stored meshes on one grid share: a server with two meshes, and the same without a server.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "load/load_mesh.h"
#include "mesh/placed_mesh.h"
#include "pipeline/voxelize.h"
#include "service/support/mesh_store_fixture.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "shaders/catalog.h"
#include "wire/placed.h"
#include "wire/request.h"

namespace voxelpipe::testing {

inline Mat4d Moved(double x, double y, double z) {
  Mat4d m;
  m.m[0][3] = x;
  m.m[1][3] = y;
  m.m[2][3] = z;
  return m;
}

inline v1::VoxelizeRequest PlacedRequestOf(const VoxelizeRequest& request, const std::vector<PlacedStored>& meshes,
                                           const CallSettings& settings = {}) {
  v1::VoxelizeRequest message = MakeRequest(request, settings);
  WriteTo(meshes, *message.mutable_mesh()->mutable_placed());
  return message;
}

inline std::string Bytes(const VoxelizeResult& result) {
  std::string all;
  for (const auto array : ArraysOf(result)) all.append(array.begin(), array.end());
  return all;
}

class PlacedMeshesTest : public MeshStoreTest {
 protected:
  // A server with two meshes.
  void StartWithMeshes(std::vector<std::string> arguments = {}) {
    ASSERT_NO_FATAL_FAILURE(Start(std::move(arguments)));
    torus_ = Upload(glb_).name;
    slab_ = Upload(slab_glb_).name;
  }

  // PlaceMeshes and Voxelize in this process.
  absl::StatusOr<VoxelizeResult> Local(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request) {
    std::map<std::string, std::shared_ptr<const TriangleMesh>> loaded;
    std::vector<PlacedMesh> list;
    for (const PlacedStored& placed : meshes) {
      std::shared_ptr<const TriangleMesh>& mesh = loaded[placed.mesh];
      if (!mesh) {
        absl::StatusOr<LoadedMesh> file =
            LoadMeshFor(job_, placed.mesh == torus_ ? glb_ : slab_glb_, {{}, TexturesRead(request), {}});
        if (!file.ok()) return file.status();
        mesh = std::make_shared<const TriangleMesh>(std::move(file->mesh));
      }
      list.push_back({mesh, placed.matrix, placed.name, placed.label, placed.priority, placed.motion});
    }
    const absl::StatusOr<TriangleMesh> all = PlaceMeshes(job_, list);
    if (!all.ok()) return all.status();
    return Voxelize(*all, request, {job_});
  }

  void ExpectAsHere(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request) {
    const auto expected = Local(meshes, request);
    ASSERT_TRUE(expected.ok()) << expected.status();
    const auto result = client_->VoxelizePlaced(meshes, request, job_);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(result->result.grid, expected->grid);
    EXPECT_TRUE(Bytes(result->result) == Bytes(*expected));
    EXPECT_EQ(result->stats.occupied, expected->stats.occupied);
    EXPECT_EQ(result->stats.odd_columns, expected->stats.odd_columns);
    EXPECT_EQ(result->report.triangles, expected->stats.triangles);
  }

  std::string HashOfPlaced(const std::vector<PlacedStored>& meshes, const VoxelizeRequest& request = SmallRequest()) {
    const auto result = client_->VoxelizePlaced(meshes, request, job_);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? result->content_sha256 : "";
  }

  // The answers of all calls that take a mesh.
  std::vector<std::pair<std::string, grpc::Status>> StatusesOf(const v1::VoxelizeRequest& request) {
    std::vector<std::pair<std::string, grpc::Status>> all;
    all.emplace_back("Voxelize", Call(*stub_, request).status);
    all.emplace_back("VoxelizeUpload", CallUpload(*stub_, {UploadOf(request)}).status);
    const auto with_context = [&](const std::string& name, const auto& call) {
      grpc::ClientContext context;
      context.set_deadline(std::chrono::system_clock::now() + kPatience);
      all.emplace_back(name, call(context));
    };
    with_context("EstimateVoxelization", [&](grpc::ClientContext& context) {
      v1::EstimateVoxelizationRequest message;
      *message.mutable_mesh() = request.mesh();
      *message.mutable_spec() = request.spec();
      v1::EstimateVoxelizationResponse response;
      return stub_->EstimateVoxelization(&context, message, &response);
    });
    with_context("ExportFile", [&](grpc::ClientContext& context) {
      v1::ExportFileRequest message;
      *message.mutable_request() = request;
      message.set_format("npy");
      const auto stream = stub_->ExportFile(&context, message);
      v1::FileChunk chunk;
      while (stream->Read(&chunk)) {}
      return stream->Finish();
    });
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    const auto stream = stub_->VoxelizeBatch(&context);
    v1::VoxelizeBatchRequest message;
    *message.add_jobs() = JobOf(1, request);
    EXPECT_TRUE(stream->Write(message));
    stream->WritesDone();
    std::map<uint64_t, Received> jobs;
    for (v1::VoxelizeBatchResponse response; stream->Read(&response);) Add(response, jobs);
    EXPECT_TRUE(stream->Finish().ok());
    all.emplace_back("VoxelizeBatch", jobs[1].status);
    return all;
  }

  const std::vector<uint8_t> slab_glb_ = TorusGlb(5);
  std::string torus_, slab_;
};

}  // namespace voxelpipe::testing
