// Who may use the page's port: pages of other origins, rebound names, tokens, addresses of clients, slow clients.
#include <memory>
#include <string>
#include <vector>

#include <grpcpp/support/status.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/certificates.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/web_fixture.h"
#include "support/json/json.h"

namespace voxelpipe::testing {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class DoorTest : public TokenServerTest {
 protected:
  int CodeOf(const HttpHeaders& headers, const std::string& method = "GET", const std::string& path = "/") {
    return Fetch(web_, method, path, headers).code;
  }
};

TEST_F(DoorTest, ThePageHasAPolicy) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const HttpReply page = Fetch(web_, "GET", "/");
  EXPECT_EQ(page.code, 200);
  EXPECT_EQ(page.Header("content-type"), "text/html; charset=utf-8");
  EXPECT_THAT(page.Header("content-security-policy"), HasSubstr("default-src 'none'; script-src 'self'"));
  EXPECT_EQ(page.Header("x-content-type-options"), "nosniff");
  EXPECT_EQ(page.Header("referrer-policy"), "no-referrer");
  EXPECT_EQ(page.Header("access-control-allow-origin"), "");
  EXPECT_EQ(Fetch(web_, "HEAD", "/").body, "");
  EXPECT_EQ(CodeOf({}, "GET", "/../etc/passwd"), 404);
  EXPECT_EQ(CodeOf({}, "GET", "/page.js"), 200);
  EXPECT_EQ(CodeOf({}, "PUT", "/"), 405);
  const json facts = ParseJson(Fetch(web_, "GET", "/facts.json").body);
  EXPECT_EQ(facts["messages"]["VoxelizeRequest"]["mesh"]["number"], v1::VoxelizeRequest::kMeshFieldNumber);
  EXPECT_EQ(facts["enums"]["Coverage"]["COVERAGE_THIN"], int(v1::COVERAGE_THIN));
}

TEST_F(DoorTest, ForeignPagesAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string own = "http://" + web_;
  EXPECT_EQ(StatusOf("ListShaders", {{"Origin", own}}), 0);
  for (const char* const origin : {"http://evil.example", "null", "https://localhost"}) {
    const WebReplyOfCall refused = CallWeb(web_, "ListShaders", "", {{"Origin", origin}});
    EXPECT_EQ(refused.http.code, 403) << origin;
    EXPECT_TRUE(refused.messages.empty());
    EXPECT_EQ(refused.http.Header("access-control-allow-origin"), "");
  }
  EXPECT_EQ(CodeOf({{"Origin", "http://evil.example"}}, "OPTIONS", WebMethod("ListShaders")), 403);
  EXPECT_EQ(CodeOf({{"Sec-Fetch-Site", "cross-site"}}), 403);
}

TEST_F(DoorTest, ReboundNamesAreRefused) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const std::string port = web_.substr(web_.rfind(':'));
  EXPECT_EQ(CodeOf({{"Host", "localhost" + port}}), 200);
  EXPECT_EQ(CodeOf({{"Host", "evil.example" + port}}), 403);
  EXPECT_EQ(StatusOf("ListShaders", {{"Host", "evil.example" + port}, {"Origin", "http://evil.example" + port}}), -1)
      << "its own origin, as the browser sees it";
}

TEST_F(DoorTest, AllowedOriginsMayCallAndRead) {
  ASSERT_NO_FATAL_FAILURE(Start({"--web-origin", "https://voxels.example.org"}));
  const HttpReply asked = Fetch(web_, "OPTIONS", WebMethod("ListShaders"),
                                {{"Origin", "https://voxels.example.org"},
                                 {"Access-Control-Request-Method", "POST"},
                                 {"Access-Control-Request-Headers", "content-type, x-grpc-web"}});
  EXPECT_EQ(asked.code, 204);
  EXPECT_EQ(asked.Header("access-control-allow-origin"), "https://voxels.example.org");
  EXPECT_THAT(asked.Header("access-control-allow-headers"), HasSubstr("x-grpc-web"));
  const WebReplyOfCall call = CallWeb(web_, "ListShaders", "", {{"Origin", "https://voxels.example.org"}});
  EXPECT_EQ(call.status, 0);
  EXPECT_EQ(call.http.Header("access-control-allow-origin"), "https://voxels.example.org");
  EXPECT_EQ(CodeOf({{"Host", "voxels.example.org"}}), 200) << "the name that a proxy passes on";
  EXPECT_EQ(CodeOf({{"Origin", "https://other.example.org"}}), 403);
}

TEST_F(DoorTest, TokensAreNeededHereToo) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  EXPECT_EQ(CodeOf({}), 200) << "the page itself needs none";
  const std::string job = Message(TorusGlb(6), SmallRequest()).SerializeAsString();
  EXPECT_EQ(StatusOf("Voxelize", {}, job), int(grpc::StatusCode::UNAUTHENTICATED));
  EXPECT_EQ(StatusOf("Voxelize", {{"Authorization", "Bearer wrong"}}, job), int(grpc::StatusCode::UNAUTHENTICATED));
  EXPECT_EQ(StatusOf("Voxelize", {{"Authorization", "Bearer token-of-the-eye"}}, job),
            int(grpc::StatusCode::PERMISSION_DENIED));
  EXPECT_EQ(StatusOf("Voxelize", {{"Authorization", "Bearer token-of-the-farm"}}, job), 0);
  EXPECT_EQ(Fetch(web_, "POST", "/file?format=npy", {{"Content-Type", "application/x-protobuf"}}, job).code, 401);
}

TEST_F(DoorTest, QuotasAreThoseOfTheTokensClient) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens());
  const HttpHeaders few = {{"Authorization", "Bearer token-of-the-few"}};
  EXPECT_EQ(StatusOf("ListShaders", few), 0);
  EXPECT_EQ(StatusOf("ListShaders", few), 0);
  EXPECT_EQ(StatusOf("ListShaders", few), int(grpc::StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_EQ(StatusOf("ListShaders", {{"Authorization", "Bearer token-of-the-farm"}}), 0);
}

TEST_F(DoorTest, TheClientIsTheConnectionsPeer) {
  ASSERT_NO_FATAL_FAILURE(Start({"--log-format", "json"}));
  const WebConnection connection(web_);
  ASSERT_TRUE(connection.Send(HttpRequest(web_, "POST", WebMethod("ListShaders"),
                                          {{"Content-Type", "application/grpc-web"},
                                           {"x-request-id", "whose-is-it"},
                                           {"voxelpiped-forwarded-peer", "ipv4:9.9.9.9:9"},
                                           {"x-forwarded-for", "9.9.9.9"}},
                                          WebFrame(""))));
  EXPECT_EQ(ParseWebReply(connection.ReadReply()).status, 0);
  EXPECT_EQ(CallLine("whose-is-it")["peer"], connection.OwnAddress());
}

TEST_F(DoorTest, BrowsersNeedATokenWhereOthersShowCertificates) {
  const auto authority = CertificateAuthority::Make();
  ASSERT_TRUE(authority.ok()) << authority.status();
  const auto files = authority->Sign("server");
  ASSERT_TRUE(files.ok()) << files.status();
  ASSERT_NO_FATAL_FAILURE(StartWithTokens({"--tls-cert", files->certificate, "--tls-key", files->key, "--tls-client-ca",
                                           authority->ca(), "--tls-client-names", "true"}));
  EXPECT_EQ(StatusOf("ListShaders", {}), int(grpc::StatusCode::UNAUTHENTICATED));
  EXPECT_EQ(StatusOf("ListShaders", {{"Authorization", "Bearer token-of-the-farm"}}), 0);
}

TEST_F(DoorTest, ClientCertificatesWithoutTokensLeaveNoOpenDoor) {
  const auto refused = RunVoxelpiped({"--listen", "127.0.0.1:0", "--web-listen", "127.0.0.1:0", "--tls-cert", "a",
                                      "--tls-key", "b", "--tls-client-ca", "c"});
  ASSERT_TRUE(refused.ok()) << refused.status();
  EXPECT_EQ(refused->exit_code, 1);
  const auto wrong = RunVoxelpiped({"--web-origin", "voxels.example.org", "--check-config"});
  ASSERT_TRUE(wrong.ok()) << wrong.status();
  EXPECT_EQ(wrong->exit_code, 2);
}

TEST_F(DoorTest, SlowClientsAreDisconnected) {
  ASSERT_NO_FATAL_FAILURE(Start({"--upload-idle-timeout-ms", "1000"}));
  const WebConnection head(web_), body(web_);
  ASSERT_TRUE(head.Send("GET / HTTP/1.1\r\nHost: "));
  ASSERT_TRUE(body.Send("POST " + WebMethod("ListShaders") + " HTTP/1.1\r\nHost: " + web_ +
                        "\r\nContent-Type: application/grpc-web\r\nContent-Length: 100000\r\n\r\n"));
  // A byte now and then does not help.
  EXPECT_TRUE(BecomesTrue([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    return !body.Send("x");
  }));
  EXPECT_TRUE(BecomesTrue([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    return !head.Send("1");
  }));
  EXPECT_EQ(StatusOf("ListShaders", {}), 0);
}

TEST_F(DoorTest, OneAddressDoesNotTakeAllConnections) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto code = [&](const char* from) {
    const WebConnection connection(web_, 0, from);
    static_cast<void>(connection.Send(HttpRequest(web_, "GET", "/")));
    return connection.ReadReply().code;
  };
  std::vector<std::unique_ptr<WebConnection>> idle;
  for (int i = 0; i < 32; ++i) idle.push_back(std::make_unique<WebConnection>(web_));
  EXPECT_EQ(code("127.0.0.1"), 0) << "closed without an answer";
  EXPECT_EQ(code("127.0.0.2"), 200);
  idle.pop_back();
  EXPECT_TRUE(BecomesTrue([&] { return code("127.0.0.1") == 200; }));
}

TEST_F(DoorTest, TheConnectionsOfAProxyNeedNoLimit) {
  ASSERT_NO_FATAL_FAILURE(Start({"--web-connections-per-address", "0"}));
  std::vector<std::unique_ptr<WebConnection>> idle;
  for (int i = 0; i < 100; ++i) idle.push_back(std::make_unique<WebConnection>(web_));
  EXPECT_EQ(CodeOf({}), 200);
}

TEST_F(DoorTest, HeadsOfAnySizeAreBounded) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const WebConnection connection(web_);
  connection.Send("GET / HTTP/1.1\r\nHost: " + web_ + "\r\nX: " + std::string(1 << 20, 'x') + "\r\n\r\n");
  const int code = connection.ReadReply().code;
  EXPECT_TRUE(code == 431 || code == 413 || code == 0) << code;
  EXPECT_EQ(CodeOf({}), 200);
}

}  // namespace
}  // namespace voxelpipe::testing
