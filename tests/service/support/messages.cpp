#include "service/support/messages.h"

#include <optional>
#include <utility>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "base/checksum/crc32c.h"
#include "google/rpc/error_details.pb.h"
#include "gtest/gtest.h"
#include "wire/request.h"

namespace voxelpipe::testing {
namespace {

void SetDeadline(grpc::ClientContext& context, std::chrono::milliseconds timeout) {
  context.set_deadline(std::chrono::system_clock::now() + timeout);
}

}  // namespace

v1::VoxelizeRequest RequestOf(const VoxelizeRequest& request, std::span<const uint8_t> file, MeshFileType type,
                              const CallSettings& settings) {
  v1::VoxelizeRequest message = MakeRequest(request, settings);
  WriteTo(type, *message.mutable_mesh()->mutable_bytes());
  SetFile(message, file);
  return message;
}

v1::VoxelizeRequest StoredRequestOf(const VoxelizeRequest& request, const std::string& name,
                                    const CallSettings& settings) {
  v1::VoxelizeRequest message = MakeRequest(request, settings);
  message.mutable_mesh()->mutable_stored()->set_name(name);
  return message;
}

void SetFile(v1::VoxelizeRequest& request, std::span<const uint8_t> file) {
  request.mutable_mesh()->mutable_bytes()->set_data(file.data(), file.size());
}

v1::VoxelizeUploadRequest UploadOf(const v1::VoxelizeRequest& request) {
  v1::VoxelizeUploadRequest message;
  *message.mutable_request() = request;
  return message;
}

v1::VoxelizeUploadRequest PieceOf(std::span<const uint8_t> bytes) {
  v1::VoxelizeUploadRequest message;
  message.set_piece(bytes.data(), bytes.size());
  return message;
}

v1::VoxelizeUploadRequest PieceOf(std::string_view bytes) {
  return PieceOf(std::span(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()));
}

v1::BatchJob JobOf(uint64_t id, v1::VoxelizeRequest request) {
  v1::BatchJob job;
  job.set_id(id);
  *job.mutable_request() = std::move(request);
  return job;
}

void Received::Add(const v1::VoxelizeResponse& response) {
  ++messages;
  EXPECT_FALSE(over) << "nothing comes after the summary or an error";
  const auto in_order = [this](int part) {
    EXPECT_LE(last_part_, part) << "plan, header, pieces, summary come in this order";
    last_part_ = part;
  };
  if (response.has_plan()) {
    in_order(v1::VoxelizeResponse::kPlanFieldNumber);
    EXPECT_EQ(++plans, 1);
    plan = response.plan();
  }
  if (response.has_progress()) {
    EXPECT_EQ(plans, 1) << "progress comes between plan and summary";
    stages.push_back(response.progress().stage());
  }
  if (response.has_header()) {
    in_order(v1::VoxelizeResponse::kHeaderFieldNumber);
    EXPECT_EQ(++headers, 1);
    header = response.header();
  }
  for (const v1::ResultPiece& piece : response.pieces()) {
    in_order(v1::VoxelizeResponse::kPiecesFieldNumber);
    EXPECT_EQ(headers, 1);
    const std::string& data = piece.data();
    EXPECT_EQ(piece.crc32c(), Crc32c({reinterpret_cast<const uint8_t*>(data.data()), data.size()}));
    if (piece.array() != array_) {
      EXPECT_GT(piece.array(), array_);
      array_ = piece.array();
      offset_ = 0;
    }
    EXPECT_EQ(piece.offset(), offset_) << "every byte once";
    offset_ += piece.has_uncompressed_bytes() ? piece.uncompressed_bytes() : int64_t(data.size());
    bytes += data;
    ++pieces;
  }
  if (response.has_summary()) {
    in_order(v1::VoxelizeResponse::kSummaryFieldNumber);
    EXPECT_EQ(headers, 1);
    EXPECT_EQ(++summaries, 1);
    summary = response.summary();
    over = true;
  }
  in_one_message = in_one_message || (response.has_header() && response.has_summary());
}

void Received::Add(const v1::BatchReply& reply) {
  if (!reply.has_error()) {
    Add(reply.response());
    return;
  }
  ++messages;
  EXPECT_FALSE(over) << "nothing comes after the summary or an error";
  over = true;
  status =
      grpc::Status(grpc::StatusCode(reply.error().code()), reply.error().message(), reply.error().SerializeAsString());
}

void Add(const v1::VoxelizeBatchResponse& response, std::map<uint64_t, Received>& jobs) {
  EXPECT_GT(response.replies_size(), 0);
  for (const v1::BatchReply& reply : response.replies()) jobs[reply.id()].Add(reply);
}

std::string ReasonOf(const grpc::Status& status) {
  return DetailOf<google::rpc::ErrorInfo>(status).reason();
}

std::string FieldOf(const grpc::Status& status) {
  const auto bad = DetailOf<google::rpc::BadRequest>(status);
  EXPECT_EQ(bad.field_violations_size(), 1);
  return bad.field_violations_size() == 1 ? bad.field_violations(0).field() : "none";
}

std::unique_ptr<v1::VoxelizationService::Stub> StubOf(const ServerProcess& server) {
  return v1::VoxelizationService::NewStub(grpc::CreateChannel(server.address(), grpc::InsecureChannelCredentials()));
}

Received Call(v1::VoxelizationService::Stub& stub, const v1::VoxelizeRequest& request,
              std::chrono::milliseconds timeout) {
  grpc::ClientContext context;
  SetDeadline(context, timeout);
  return Collect(*stub.Voxelize(&context, request));
}

Received CallUpload(v1::VoxelizationService::Stub& stub, const std::vector<v1::VoxelizeUploadRequest>& messages,
                    std::chrono::milliseconds timeout) {
  grpc::ClientContext context;
  SetDeadline(context, timeout);
  const auto stream = stub.VoxelizeUpload(&context);
  for (const v1::VoxelizeUploadRequest& message : messages) {
    if (!stream->Write(message)) break;
  }
  stream->WritesDone();
  return Collect(*stream);
}

Received CallUpload(v1::VoxelizationService::Stub& stub, const v1::VoxelizeRequest& request,
                    std::chrono::milliseconds timeout) {
  std::vector<v1::VoxelizeUploadRequest> messages{UploadOf(request)};
  const auto split = [&](auto& mesh) {
    if (!mesh.data().empty() || mesh.has_crc32c()) {
      messages.push_back(PieceOf(mesh.data()));
      if (mesh.has_crc32c()) messages.back().set_crc32c(mesh.crc32c());
    }
    mesh.clear_data();
    mesh.clear_crc32c();
  };
  v1::MeshSource& mesh = *messages[0].mutable_request()->mutable_mesh();
  if (mesh.has_bytes()) {
    split(*mesh.mutable_bytes());
  } else if (mesh.stored().has_positions()) {
    split(*mesh.mutable_stored()->mutable_positions());
  }
  return CallUpload(stub, messages, timeout);
}

}  // namespace voxelpipe::testing
