// Calls over gRPC-Web: the same bytes as over gRPC, and the same end.
#include <signal.h>

#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/web_fixture.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

constexpr char kCancelledCalls[] = "voxelpipe_calls_total{code=\"CANCELLED\",method=\"Voxelize\"}";

// The parts of a result that do not depend on time: its header, its bytes, their hash. Where its pieces end does.
std::string Bytes(const std::vector<v1::VoxelizeResponse>& messages) {
  std::string bytes;
  for (const v1::VoxelizeResponse& message : messages) {
    if (message.has_header()) bytes += message.header().SerializeAsString();
    for (const v1::ResultPiece& piece : message.pieces()) bytes += piece.data();
    bytes += message.summary().content_sha256();
  }
  return bytes;
}

std::vector<v1::VoxelizeResponse> Parsed(const std::vector<std::string>& messages) {
  std::vector<v1::VoxelizeResponse> parsed(messages.size());
  for (size_t i = 0; i < messages.size(); ++i) EXPECT_TRUE(parsed[i].ParseFromString(messages[i]));
  return parsed;
}

class BridgeTest : public WebServerTest {
 protected:
  std::vector<v1::VoxelizeResponse> OverGrpc(const v1::VoxelizeRequest& request) {
    const auto stub =
        v1::VoxelizationService::NewStub(grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials()));
    grpc::ClientContext context;
    const auto stream = stub->Voxelize(&context, request);
    std::vector<v1::VoxelizeResponse> messages;
    for (v1::VoxelizeResponse message; stream->Read(&message);) messages.push_back(message);
    EXPECT_TRUE(stream->Finish().ok());
    return messages;
  }
  // A call that runs until it is ended.
  v1::VoxelizeRequest Endless() const { return Message(LargeTrianglesGlb(20'000), SlowRequest()); }
  std::string PostOf(const v1::VoxelizeRequest& request) const {
    return HttpRequest(web_, "POST", WebMethod("Voxelize"), {{"Content-Type", "application/grpc-web"}},
                       WebFrame(request.SerializeAsString()));
  }
};

TEST_F(BridgeTest, ResultsHaveTheSameBytesAsOverGrpc) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest small = SmallRequest(), large = SmallRequest();
  large.grid.resolution = 192;  // pieces
  large.targets[0].format = VoxelFormat::kU8;
  large.targets[0].components = 3;
  large.targets[0].blend = Blend::kReplace;
  large.targets[0].shader = {"normal", {}};
  VoxelizeRequest sparse = large;
  sparse.result = ResultKind::kSparse;
  for (const VoxelizeRequest& request : {small, large, sparse}) {
    const v1::VoxelizeRequest message = Message(TorusGlb(24), request);
    const WebReplyOfCall web = CallWeb(web_, "Voxelize", message.SerializeAsString());
    EXPECT_EQ(web.http.code, 200);
    EXPECT_EQ(web.http.Header("content-type"), "application/grpc-web+proto");
    EXPECT_TRUE(web.http.complete);
    EXPECT_EQ(web.status, 0) << web.trailers;
    const std::string bytes = Bytes(Parsed(web.messages));
    EXPECT_GT(bytes.size(), 500u);
    EXPECT_TRUE(bytes == Bytes(OverGrpc(message)));
  }
}

TEST_F(BridgeTest, UnaryCalls) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const WebReplyOfCall shaders = CallWeb(web_, "ListShaders", "", {{"x-request-id", "from-the-page"}});
  EXPECT_EQ(shaders.status, 0);
  EXPECT_EQ(shaders.http.Header("x-request-id"), "from-the-page");
  ASSERT_EQ(shaders.messages.size(), 1u);
  v1::ListShadersResponse response;
  ASSERT_TRUE(response.ParseFromString(shaders.messages[0]));
  EXPECT_GT(response.shaders_size(), 5);

  const v1::VoxelizeRequest request = Message(TorusGlb(8), SmallRequest());
  v1::EstimateVoxelizationRequest estimate;
  *estimate.mutable_mesh() = request.mesh();
  *estimate.mutable_spec() = request.spec();
  const WebReplyOfCall plan = CallWeb(web_, "EstimateVoxelization", estimate.SerializeAsString());
  EXPECT_EQ(plan.status, 0);
  v1::EstimateVoxelizationResponse estimated;
  ASSERT_EQ(plan.messages.size(), 1u);
  ASSERT_TRUE(estimated.ParseFromString(plan.messages[0]));
  EXPECT_EQ(estimated.report().triangles(), 128);
}

TEST_F(BridgeTest, AStoredMeshIsNamedByLaterRequests) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::VoxelizeRequest request = Message(TorusGlb(24), SmallRequest());
  const std::string of_bytes = Bytes(Parsed(CallWeb(web_, "Voxelize", request.SerializeAsString()).messages));
  v1::CreateMeshRequest create;
  *create.mutable_mesh() = request.mesh().bytes();
  v1::Mesh mesh;
  for (const bool stored_before : {false, true}) {
    const WebReplyOfCall created = CallWeb(web_, "CreateMesh", create.SerializeAsString());
    ASSERT_EQ(created.status, 0) << created.trailers;
    ASSERT_EQ(created.messages.size(), 1u);
    ASSERT_TRUE(mesh.ParseFromString(created.messages[0]));
    EXPECT_EQ(mesh.already_stored(), stored_before);
  }
  request.mutable_mesh()->mutable_stored()->set_name(mesh.name());
  const WebReplyOfCall voxels = CallWeb(web_, "Voxelize", request.SerializeAsString());
  EXPECT_EQ(voxels.status, 0) << voxels.trailers;
  EXPECT_GT(of_bytes.size(), 500u);
  EXPECT_TRUE(Bytes(Parsed(voxels.messages)) == of_bytes);

  v1::ReleaseMeshRequest release;
  release.set_name(mesh.name());
  EXPECT_EQ(CallWeb(web_, "ReleaseMesh", release.SerializeAsString()).status, 0);
  EXPECT_EQ(CallWeb(web_, "Voxelize", request.SerializeAsString()).status, int(grpc::StatusCode::NOT_FOUND));
}

TEST_F(BridgeTest, ErrorsAreTrailersWithTheirDetails) {
  ASSERT_NO_FATAL_FAILURE(Start());
  v1::GetMeshRequest request;
  request.set_name("meshes/" + std::string(64, 'a'));
  const WebReplyOfCall missing = CallWeb(web_, "GetMesh", request.SerializeAsString());
  EXPECT_EQ(missing.http.code, 200);
  EXPECT_EQ(missing.status, int(grpc::StatusCode::NOT_FOUND));
  EXPECT_THAT(missing.trailers, HasSubstr("grpc-message: "));
  EXPECT_THAT(missing.trailers, HasSubstr("grpc-status-details-bin: "));
  EXPECT_TRUE(missing.messages.empty());

  EXPECT_EQ(CallWeb(web_, "GetMesh", "\xff\xff").status, int(grpc::StatusCode::INVALID_ARGUMENT));
  EXPECT_EQ(CallWeb(web_, "Nothing", "").status, int(grpc::StatusCode::UNIMPLEMENTED));
  for (const char* const streams : {"VoxelizeUpload", "VoxelizeBatch", "UploadMesh"}) {
    const WebReplyOfCall refused = CallWeb(web_, streams, "");
    EXPECT_EQ(refused.status, int(grpc::StatusCode::UNIMPLEMENTED));
    EXPECT_THAT(refused.trailers, HasSubstr("Voxelize and CreateMesh take a mesh in one message"));
  }
}

TEST_F(BridgeTest, FramesThatAreNone) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto post = [&](const std::string& body, const std::string& type = "application/grpc-web+proto") {
    return ParseWebReply(Fetch(web_, "POST", WebMethod("ListShaders"), {{"Content-Type", type}}, body));
  };
  const int invalid = int(grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(post(WebFrame("")).status, 0);
  EXPECT_EQ(post(std::string(4, '\0')).status, invalid);
  EXPECT_EQ(post(std::string("\0\0\0\0\x07 abc", 9)).status, invalid) << "truncated";
  EXPECT_EQ(post(WebFrame("") + WebFrame("")).status, invalid) << "two messages";
  EXPECT_EQ(post(std::string("\x01\0\0\0\0", 5)).status, int(grpc::StatusCode::UNIMPLEMENTED)) << "compressed";
  EXPECT_EQ(post("", "application/grpc-web+proto").status, invalid) << "no body";
  EXPECT_EQ(post(WebFrame(""), "text/plain").http.code, 415);
  EXPECT_EQ(post(WebFrame(""), "application/json").http.code, 415);
  const WebReplyOfCall timeout =
      ParseWebReply(Fetch(web_, "POST", WebMethod("ListShaders"),
                          {{"Content-Type", "application/grpc-web+proto"}, {"grpc-timeout", "soon"}}, WebFrame("")));
  EXPECT_EQ(timeout.status, invalid);
  const WebReplyOfCall binary = CallWeb(web_, "ListShaders", "", {{"authorization", "Bearer \x80\x01"}});
  EXPECT_TRUE(binary.status == invalid || binary.http.code == 400) << "gRPC cannot carry it";
  EXPECT_EQ(post(WebFrame("")).status, 0) << "the server goes on";
}

TEST_F(BridgeTest, ABodyBeyondTheLimitIsRefusedBeforeItIsRead) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const WebConnection connection(web_);
  ASSERT_TRUE(connection.Send("POST " + WebMethod("Voxelize") + " HTTP/1.1\r\nHost: " + web_ +
                              "\r\nContent-Type: application/grpc-web\r\nContent-Length: 67108870\r\n\r\n"));
  const WebReplyOfCall refused = ParseWebReply(connection.ReadReply());
  EXPECT_EQ(refused.status, int(grpc::StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_THAT(refused.trailers, HasSubstr("larger meshes go through gRPC's VoxelizeUpload"));
}

TEST_F(BridgeTest, ChunkedBodies) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const WebConnection connection(web_);
  ASSERT_TRUE(connection.Send("POST " + WebMethod("GetServerInfo") + " HTTP/1.1\r\nHost: " + web_ +
                              "\r\nContent-Type: application/grpc-web\r\nTransfer-Encoding: chunked\r\n\r\n"));
  ASSERT_TRUE(connection.Send(std::string("2\r\n\0\0\r\n3\r\n\0\0\0\r\n0\r\n\r\n", 20)));
  EXPECT_EQ(ParseWebReply(connection.ReadReply()).status, 0);
}

TEST_F(BridgeTest, AClientThatHangsUpEndsItsJob) {
  ASSERT_NO_FATAL_FAILURE(Start({"--threads", "1", "--workers", "1"}));
  {
    const WebConnection connection(web_);
    ASSERT_TRUE(connection.Send(PostOf(Endless())));
    ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 1; }));
  }
  EXPECT_TRUE(BecomesTrue([&] { return Sample(kCancelledCalls) == 1; }));
  EXPECT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 0; }));
}

TEST_F(BridgeTest, ADeadlineEndsTheCall) {
  ASSERT_NO_FATAL_FAILURE(Start({"--threads", "1", "--workers", "1"}));
  const WebReplyOfCall late = CallWeb(web_, "Voxelize", Endless().SerializeAsString(), {{"grpc-timeout", "300m"}});
  EXPECT_EQ(late.status, int(grpc::StatusCode::DEADLINE_EXCEEDED));
}

TEST_F(BridgeTest, AClientThatReadsNothingIsDisconnected) {
  ASSERT_NO_FATAL_FAILURE(Start({"--stall-timeout-ms", "1000"}));
  VoxelizeRequest large = SmallRequest();
  large.grid.dims = {256, 256, 256};
  large.grid.voxel_size = Vec3d{0.02, 0.02, 0.02};
  large.grid.origin = Vec3d{0, 0, 0};
  large.targets[0].format = VoxelFormat::kF32;
  large.targets[0].blend = Blend::kReplace;
  const WebConnection connection(web_, 4096);
  ASSERT_TRUE(connection.Send(PostOf(Message(TorusGlb(6), large))));
  EXPECT_TRUE(BecomesTrue([&] {
    return Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}") == 0 &&
           Sample("voxelpipe_calls_total{code=\"OK\",method=\"Voxelize\"}") <= 0 &&
           Log().find("method=Voxelize") != std::string::npos;
  })) << Log();
  HttpReply cut = connection.ReadReply();
  EXPECT_FALSE(cut.complete);
  EXPECT_EQ(ParseWebReply(cut).status, -1) << "a response that was cut has no status";
}

TEST_F(BridgeTest, ADrainingServerAnswersWhatRuns) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "0", "--drain-grace-ms", "60000"}));
  VoxelizeRequest request = SmallRequest();
  request.grid.resolution = 256;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kMax;
  request.targets[0].shader = {"barycentric", {}};
  const WebConnection connection(web_);
  ASSERT_TRUE(connection.Send(PostOf(Message(LargeTrianglesGlb(60), request))));
  ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}") == 1; }));
  server_->Signal(SIGTERM);
  const WebReplyOfCall answered = ParseWebReply(connection.ReadReply());
  EXPECT_EQ(answered.status, 0) << answered.trailers;
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

}  // namespace
}  // namespace voxelpipe::testing
