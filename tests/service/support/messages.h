// The messages of calls: those that a client sends, and what comes back, read to its end.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <grpcpp/support/status.h>

#include "google/rpc/status.pb.h"
#include "gtest/gtest.h"
#include "job/request.h"
#include "load/loader.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/call_settings.h"

namespace voxelpipe::testing {

// ---- what is sent

// A request with a mesh file; without bytes if they follow in pieces.
v1::VoxelizeRequest RequestOf(const VoxelizeRequest& request, std::span<const uint8_t> file = {},
                              MeshFileType type = MeshFormat::kGlb, const CallSettings& settings = {});
// The same with a stored mesh.
v1::VoxelizeRequest StoredRequestOf(const VoxelizeRequest& request, const std::string& name,
                                    const CallSettings& settings = {});
// Replaces the bytes of the mesh file.
void SetFile(v1::VoxelizeRequest& request, std::span<const uint8_t> file);

// The first message of VoxelizeUpload, and a piece.
v1::VoxelizeUploadRequest UploadOf(const v1::VoxelizeRequest& request);
v1::VoxelizeUploadRequest PieceOf(std::span<const uint8_t> bytes);
v1::VoxelizeUploadRequest PieceOf(std::string_view bytes);

// One job of VoxelizeBatch.
v1::BatchJob JobOf(uint64_t id, v1::VoxelizeRequest request);

// ---- what comes back

// Of one call, or of one job of a batch.
struct Received {
  v1::VoxelizationPlan plan;
  v1::ResultHeader header;
  v1::Summary summary;
  std::string bytes;                // of all pieces, as sent
  std::vector<std::string> stages;  // of the progress
  int messages = 0, plans = 0, headers = 0, pieces = 0, summaries = 0;
  bool in_one_message = false;  // header and summary came in one
  bool over = false;            // nothing may follow
  grpc::Status status;

  // The next message. Fails the test if its parts do not come in the order of the contract, or if a piece is not the
  // next one or has not the bytes of its checksum.
  void Add(const v1::VoxelizeResponse& response);
  // The same of a batch.
  void Add(const v1::BatchReply& reply);

 private:
  int last_part_ = 0;  // the number of its field
  int32_t array_ = 0;
  int64_t offset_ = 0;  // of the next piece in its array
};

// Reads a call with one result to its end.
template <typename Stream>
Received Collect(Stream& stream) {
  Received received;
  for (v1::VoxelizeResponse response; stream.Read(&response);) received.Add(response);
  received.status = stream.Finish();
  return received;
}

// Adds the replies of a message to those of their jobs.
void Add(const v1::VoxelizeBatchResponse& response, std::map<uint64_t, Received>& jobs);

// The one detail of this type of an error; fails the test if there is none.
template <typename Detail>
Detail DetailOf(const grpc::Status& status) {
  google::rpc::Status all;
  EXPECT_TRUE(all.ParseFromString(status.error_details()));
  Detail detail;
  int found = 0;
  for (const google::protobuf::Any& any : all.details()) found += any.UnpackTo(&detail) ? 1 : 0;
  EXPECT_EQ(found, 1) << status.error_message() << "\n" << all.DebugString();
  return detail;
}
// The reason of its ErrorInfo, which every error has.
std::string ReasonOf(const grpc::Status& status);
// The field of its BadRequest.
std::string FieldOf(const grpc::Status& status);

// ---- whole calls

std::unique_ptr<v1::VoxelizationService::Stub> StubOf(const ServerProcess& server);
// Voxelize.
Received Call(v1::VoxelizationService::Stub& stub, const v1::VoxelizeRequest& request,
              std::chrono::milliseconds timeout = kPatience);
// VoxelizeUpload with these messages as they are, then the end of this side.
Received CallUpload(v1::VoxelizationService::Stub& stub, const std::vector<v1::VoxelizeUploadRequest>& messages,
                    std::chrono::milliseconds timeout = kPatience);
// The same request by VoxelizeUpload: the bytes of its mesh file, or its new positions, come in one piece behind it.
Received CallUpload(v1::VoxelizationService::Stub& stub, const v1::VoxelizeRequest& request,
                    std::chrono::milliseconds timeout = kPatience);

}  // namespace voxelpipe::testing
