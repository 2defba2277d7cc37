// What the head of a request decides: who may not make the call is refused before the body, which costs nothing.
#include <signal.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
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

constexpr char kFramed[] = "application/grpc-web", kMessage[] = "application/x-protobuf";
constexpr char kFarm[] = "Bearer token-of-the-farm";

class HeadTest : public TokenServerTest {
 protected:
  // The head of a request whose body has 60 MiB.
  std::string Head(const std::string& path, const std::string& type, const HttpHeaders& more,
                   const std::string& body = "Content-Length: 62914560") const {
    HttpHeaders headers = more;
    headers.emplace_back("Content-Type", type);
    std::string head = HttpRequest(web_, "POST", path, headers);
    return head.insert(head.size() - 2, body + "\r\n");
  }
  std::string Method(const HttpHeaders& more, const std::string& name = "Voxelize") const {
    return Head(WebMethod(name), kFramed, more);
  }
  // The answer to the head alone.
  HttpReply Ask(const std::string& head) const {
    const WebConnection connection(web_);
    EXPECT_TRUE(connection.Send(head));
    return connection.ReadReply();
  }
  std::string Job() const { return Message(TorusGlb(6), SmallRequest()).SerializeAsString(); }
  grpc::Status VoxelizeOverGrpc() const {
    const auto stub =
        v1::VoxelizationService::NewStub(grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials()));
    grpc::ClientContext context;
    context.AddMetadata("authorization", kFarm);
    const auto stream = stub->Voxelize(&context, Message(TorusGlb(6), SmallRequest()));
    for (v1::VoxelizeResponse message; stream->Read(&message);) continue;
    return stream->Finish();
  }
  double Calls(const std::string& code) {
    return Sample("voxelpipe_calls_total{code=\"" + code + "\",method=\"Voxelize\"}");
  }
};

TEST_F(HeadTest, TheTokenComesBeforeTheBody) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const struct {
    HttpHeaders headers;
    grpc::StatusCode status;
    int code;
    const char* text;
  } refused[] = {
      {{}, grpc::StatusCode::UNAUTHENTICATED, 401, "a token is needed"},
      {{{"Authorization", "Bearer wrong"}}, grpc::StatusCode::UNAUTHENTICATED, 401, "the token is unknown"},
      {{{"Authorization", "Bearer token-of-the-eye"}},
       grpc::StatusCode::PERMISSION_DENIED,
       403,
       "the role monitor of eye may not call Voxelize"},
  };
  for (const auto& [headers, status, code, text] : refused) {
    const WebReplyOfCall call = ParseWebReply(Ask(Method(headers)));
    EXPECT_EQ(call.status, int(status)) << text;
    EXPECT_THAT(call.trailers, HasSubstr(text));
    EXPECT_EQ(call.http.Header("content-type"), "application/grpc-web+proto");
    EXPECT_FALSE(call.http.Header("x-request-id").empty());
    const HttpReply file = Ask(Head("/file?format=npy", kMessage, headers));
    EXPECT_EQ(file.code, code) << text;
    EXPECT_THAT(file.body, HasSubstr(text));
    EXPECT_EQ(file.Header("grpc-status"), std::to_string(int(status)));
  }
  EXPECT_EQ(ParseWebReply(Ask(Method({}, "EstimateVoxelization"))).status, int(grpc::StatusCode::UNAUTHENTICATED));
  EXPECT_EQ(Sample("voxelpipe_refused_total{reason=\"no_token\"}"), 3);
  EXPECT_EQ(Sample("voxelpipe_refused_total{reason=\"bad_token\"}"), 2);
  EXPECT_EQ(Sample("voxelpipe_refused_total{reason=\"role\"}"), 2);
  EXPECT_EQ(Calls("UNAUTHENTICATED"), 4);
  EXPECT_EQ(Calls("PERMISSION_DENIED"), 2);
  EXPECT_EQ(Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}"), 0);
  EXPECT_EQ(StatusOf("Voxelize", {{"Authorization", kFarm}}, Job()), 0);
}

TEST_F(HeadTest, ARefusedRequestIsLoggedOnce) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const WebConnection connection(web_);
  ASSERT_TRUE(
      connection.Send(Method({{"Authorization", "Bearer token-of-the-eye"}, {"x-request-id", "from-the-page"}})));
  EXPECT_EQ(connection.ReadReply().Header("x-request-id"), "from-the-page");
  const nlohmann::json line = CallLine("from-the-page");
  EXPECT_EQ(line["method"], "Voxelize");
  EXPECT_EQ(line["client"], "eye");
  EXPECT_EQ(line["code"], "PERMISSION_DENIED");
  EXPECT_EQ(line["peer"], connection.OwnAddress());
  EXPECT_EQ(line["in"], 0);
  const std::string log = Log();
  EXPECT_EQ(log.find("from-the-page"), log.rfind("from-the-page"));
}

TEST_F(HeadTest, BodiesOfStrangersTakeNoUploadMemory) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens({"--max-upload-bytes", "8MiB", "--max-file-bytes", "8MiB"}));
  std::vector<std::unique_ptr<WebConnection>> strangers;
  std::vector<std::thread> senders;
  for (int i = 0; i < 24; ++i) {
    const WebConnection& stranger = *strangers.emplace_back(std::make_unique<WebConnection>(web_));
    senders.emplace_back([&stranger, head = Method({})] {
      static_cast<void>(stranger.Send(head + std::string(1 << 20, 'x')));  // the rest would come later
    });
  }
  EXPECT_TRUE(BecomesTrue([&] { return Calls("UNAUTHENTICATED") == 24; }));
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
  EXPECT_EQ(StatusOf("Voxelize", {{"Authorization", kFarm}}, Job()), 0);
  const grpc::Status status = VoxelizeOverGrpc();
  EXPECT_TRUE(status.ok()) << status.error_message();
  for (std::thread& sender : senders) sender.join();
}

TEST_F(HeadTest, QuotasComeBeforeTheBodyAndAreTakenOnce) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const HttpHeaders few = {{"Authorization", "Bearer token-of-the-few"}};
  EXPECT_EQ(StatusOf("Voxelize", few, Job()), 0);
  EXPECT_EQ(StatusOf("Voxelize", few, Job()), 0);
  const WebReplyOfCall third = ParseWebReply(Ask(Method(few)));
  EXPECT_EQ(third.status, int(grpc::StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_THAT(third.trailers, HasSubstr("the quota of calls a second is used up"));
  EXPECT_THAT(third.trailers, HasSubstr("grpc-status-details-bin: ")) << "the delay";
  EXPECT_EQ(Sample("voxelpipe_refused_total{reason=\"quota_rate\"}"), 1);
}

TEST_F(HeadTest, WhatElseTheHeadTells) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const HttpReply format = Ask(Head("/file?format=doc", kMessage, {}));
  EXPECT_EQ(format.code, 400);
  EXPECT_THAT(format.body, HasSubstr("'doc' is not one of npy, npz"));
  EXPECT_EQ(Ask(Head("/file?format=npy", kMessage, {{"grpc-timeout", "soon"}})).code, 400);
  EXPECT_EQ(ParseWebReply(Ask(Method({{"grpc-timeout", "soon"}}))).status, int(grpc::StatusCode::INVALID_ARGUMENT));
  EXPECT_EQ(ParseWebReply(Ask(Method({}, "Nothing"))).status, int(grpc::StatusCode::UNIMPLEMENTED));
  EXPECT_EQ(ParseWebReply(Ask(Head(WebMethod("GetMesh"), kFramed, {}, "Content-Length: 67108870"))).status,
            int(grpc::StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_EQ(Ask(Head(WebMethod("GetMesh"), "text/plain", {})).code, 415);
  EXPECT_EQ(Ask(Head(WebMethod("GetMesh"), kFramed, {{"Origin", "http://evil.example"}})).code, 403);
}

TEST_F(HeadTest, ClientsThatWaitAreToldToContinueOrNot) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const std::string frame = WebFrame(Job()), length = "Content-Length: " + std::to_string(frame.size());
  const HttpReply stranger = Ask(Head("/file?format=npy", kMessage, {{"Expect", "100-continue"}}));
  EXPECT_EQ(stranger.code, 401) << "not 100";
  const WebConnection owner(web_);
  ASSERT_TRUE(
      owner.Send(Head(WebMethod("Voxelize"), kFramed, {{"Expect", "100-continue"}, {"Authorization", kFarm}}, length)));
  EXPECT_THAT(owner.Receive(), HasSubstr("HTTP/1.1 100 "));
  ASSERT_TRUE(owner.Send(frame));
  EXPECT_EQ(ParseWebReply(owner.ReadReply()).status, 0);
}

TEST_F(HeadTest, ChunkedBodiesOfStrangersAreNotReadEither) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const std::string chunked = "Transfer-Encoding: chunked";
  EXPECT_EQ(Ask(Head("/file?format=npy", kMessage, {}, chunked)).code, 401);
  EXPECT_EQ(Ask(Head("/file?format=npy", kMessage, {}, chunked) + "3\r\nabc\r\n").code, 401);
}

TEST_F(HeadTest, AClientThatSendsItsWholeBodyFirstGetsTheAnswer) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const std::string body(16 << 20, 'x');  // more than the sockets hold
  const WebConnection connection(web_);
  EXPECT_TRUE(connection.Send(Head("/file?format=npy", kMessage, {}, "Content-Length: 16777216") + body));
  const HttpReply reply = connection.ReadReply();
  EXPECT_EQ(reply.code, 401);
  EXPECT_THAT(reply.body, HasSubstr("a token is needed"));
}

TEST_F(HeadTest, ARefusedClientThatGoesOnIsDisconnected) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const WebConnection connection(web_);
  ASSERT_TRUE(connection.Send(Method({})));
  EXPECT_EQ(ParseWebReply(connection.ReadReply()).status, int(grpc::StatusCode::UNAUTHENTICATED));
  EXPECT_TRUE(BecomesTrue([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return !connection.Send("x");
  }));
}

TEST_F(HeadTest, ADrainingServerRefusesBeforeTheBody) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--threads", "1", "--workers", "1", "--lame-duck-ms", "0", "--drain-grace-ms", "60000"}));
  {
    const WebConnection running(web_);
    ASSERT_TRUE(
        running.Send(HttpRequest(web_, "POST", WebMethod("Voxelize"), {{"Content-Type", kFramed}},
                                 WebFrame(Message(LargeTrianglesGlb(20'000), SlowRequest()).SerializeAsString()))));
    ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 1; }));
    server_->Signal(SIGTERM);
    ASSERT_TRUE(Logs("draining"));
    EXPECT_TRUE(BecomesTrue([&] {
      return ParseWebReply(Fetch(web_, "POST", WebMethod("Voxelize"), {{"Content-Type", kFramed}}, WebFrame("")))
                 .status == int(grpc::StatusCode::UNAVAILABLE);
    }));
    const HttpReply file = Ask(Head("/file?format=npy", kMessage, {}));
    EXPECT_EQ(file.code, 503);
    EXPECT_THAT(file.body, HasSubstr("shutting down"));
  }
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(HeadTest, AFullQueueRefusesBeforeTheBody) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--threads", "1", "--workers", "1", "--max-queue", "1", "--share-equal-jobs", "false"}));
  const std::string slow = HttpRequest(web_, "POST", WebMethod("Voxelize"), {{"Content-Type", kFramed}},
                                       WebFrame(Message(LargeTrianglesGlb(20'000), SlowRequest()).SerializeAsString()));
  const WebConnection running(web_), waiting(web_);
  ASSERT_TRUE(running.Send(slow));
  ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_running_jobs") == 1; }));
  ASSERT_TRUE(waiting.Send(slow));
  ASSERT_TRUE(BecomesTrue([&] { return Sample("voxelpipe_queue_jobs{priority=\"normal\"}") == 1; }));
  const WebReplyOfCall refused = ParseWebReply(Ask(Method({})));
  EXPECT_EQ(refused.status, int(grpc::StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_THAT(refused.trailers, HasSubstr("grpc-status-details-bin: ")) << "the delay";
}

}  // namespace
}  // namespace voxelpipe::testing
