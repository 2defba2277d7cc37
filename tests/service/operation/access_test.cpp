// Who may talk to a server, and what it says of those who may not.
#include <signal.h>
#include <sys/resource.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "gmock/gmock.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "gtest/gtest.h"
#include "service/support/certificates.h"
#include "service/support/http_get.h"
#include "service/support/process_facts.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;

// True if it becomes true while a test waits.
bool Soon(const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

class AccessTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("GRPC_VERBOSITY", "NONE", 0); }  // of this process's own clients
  void SetUp() override {
    auto authority = CertificateAuthority::Make();
    ASSERT_TRUE(authority.ok()) << authority.status();
    authority_ = std::make_unique<CertificateAuthority>(*std::move(authority));
    log_path_ = authority_->folder() + "/server.log";
  }
  void Start(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--http-listen", "127.0.0.1:0"});
    server_ = StartServer(arguments, log_path_);
    ASSERT_NE(server_, nullptr);
    auto http = server_->http_address();
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *http;
  }
  void StartWithTls(const std::vector<std::string>& more = {}) {
    const auto files = authority_->Sign("server");
    ASSERT_TRUE(files.ok()) << files.status();
    std::vector<std::string> arguments = {"--tls-cert", files->certificate,     "--tls-key",
                                          files->key,   "--reload-interval-ms", "1000"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Start(arguments);
  }

  absl::StatusOr<std::unique_ptr<Client>> Connect(std::optional<ClientTls> tls, const std::string& token = "") {
    ConnectOptions options;
    options.timeout = kPatience;
    options.tls = std::move(tls);
    options.token = token;
    options.retries = 0;
    return Client::Connect(server_->address(), options);
  }
  // The status of a small job on a connection that stands, or of the connection.
  absl::Status Work(std::optional<ClientTls> tls, const std::string& token = "") {
    const auto client = Connect(std::move(tls), token);
    if (!client.ok()) return client.status();
    const JobContext job;
    return (*client)->Voxelize(TorusGlb(6), MeshFormat::kGlb, SmallRequest(), job).status();
  }
  ClientTls Believing() const {
    ClientTls tls;
    tls.ca_file = authority_->ca();
    return tls;
  }

  ClientTls Showing(const CertificateFiles& files) const {
    ClientTls tls = Believing();
    tls.cert_file = files.certificate;
    tls.key_file = files.key;
    return tls;
  }

  double Sample(const std::string& name) { return SampleOf(HttpGet(http_, "/metrics"), name); }
  double Refused(const std::string& reason) { return Sample("voxelpipe_refused_total{reason=\"" + reason + "\"}"); }
  std::string Log() const {
    std::ifstream file(log_path_);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  bool Logged(const std::string& text) {
    return Soon([&] { return Log().find(text) != std::string::npos; });
  }

  std::unique_ptr<CertificateAuthority> authority_;
  std::string log_path_, http_;
  std::unique_ptr<ServerProcess> server_;
};

TEST_F(AccessTest, TlsServesThoseWhoBelieveTheCertificate) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  EXPECT_TRUE(Work(Believing()).ok()) << Work(Believing());
  ClientTls named = Believing();
  named.server_name = "server.test";
  EXPECT_TRUE(Work(named).ok()) << Work(named);
  named.server_name = "other.test";
  EXPECT_EQ(Work(named).code(), absl::StatusCode::kUnavailable) << "the certificate is for another name";
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  ClientTls strange;
  strange.ca_file = others->ca();
  EXPECT_EQ(Work(strange).code(), absl::StatusCode::kUnavailable) << "signed by somebody else";
  EXPECT_GT(Sample("voxelpipe_certificate_expiry_timestamp_seconds"), 1e9);
}

TEST_F(AccessTest, APlaintextClientOnATlsPortIsRefusedLoggedAndCounted) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  ASSERT_EQ(Refused("tls_handshake"), 0);
  const absl::Status status = Work(std::nullopt);
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
  EXPECT_TRUE(Soon([&] { return Refused("tls_handshake") >= 1; }));
  EXPECT_TRUE(Logged("tls_handshake_failed error=")) << Log();
  EXPECT_TRUE(Work(Believing()).ok()) << "others are served as before";
}

TEST_F(AccessTest, AClientSaysThatTheCertificateDoesNotVerify) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  ClientTls foreign;
  foreign.ca_file = others->ca();
  ClientTls misnamed;
  misnamed.ca_file = authority_->ca();
  misnamed.server_name = "another.test";
  for (const ClientTls& tls : {foreign, misnamed}) {
    const absl::Status status = Work(tls);
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("certificate verification failed")) << status;
    EXPECT_TRUE(IsConnectError(status));
  }
}

TEST_F(AccessTest, MutualTlsServesThoseWithACertificateThatIsValid) {
  const auto good = authority_->Sign("client"), expired = authority_->Sign("late", /*days=*/0);
  ASSERT_TRUE(good.ok()) << good.status();
  ASSERT_TRUE(expired.ok()) << expired.status();
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  const auto foreign = others->Sign("client");
  ASSERT_TRUE(foreign.ok());
  ASSERT_NO_FATAL_FAILURE(StartWithTls({"--tls-client-ca", authority_->ca()}));
  const auto showing = [&](const CertificateFiles& files) { return Showing(files); };
  EXPECT_TRUE(Work(showing(*good)).ok()) << Work(showing(*good));
  EXPECT_EQ(Refused("tls_handshake"), 0);
  EXPECT_FALSE(Work(Believing()).ok()) << "no certificate at all";
  EXPECT_TRUE(Logged("peer did not return a certificate")) << Log();
  EXPECT_FALSE(Work(showing(*expired)).ok());
  EXPECT_TRUE(Soon([&] { return Refused("tls_handshake") >= 2; }));
  EXPECT_FALSE(Work(showing(*foreign)).ok());
  EXPECT_TRUE(Soon([&] { return Refused("tls_handshake") >= 3; }));
  EXPECT_TRUE(Logged("certificate verify failed")) << Log();
  EXPECT_TRUE(Work(showing(*good)).ok());
}

TEST_F(AccessTest, WithoutTokensACertificateNamesItsClient) {
  const auto files = authority_->Sign("client");
  ASSERT_TRUE(files.ok()) << files.status();
  ASSERT_NO_FATAL_FAILURE(StartWithTls({"--tls-client-ca", authority_->ca(), "--tls-client-names", "true"}));
  EXPECT_TRUE(Work(Showing(*files)).ok());
  EXPECT_TRUE(Logged("client=client.test code=OK")) << Log();
}

TEST_F(AccessTest, AChangedCertificateIsShownWithoutARestart) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  const auto open = Connect(Believing());
  ASSERT_TRUE(open.ok()) << open.status();
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  const auto files = others->Sign("server");
  ASSERT_TRUE(files.ok());
  for (const auto& [from, to] : {std::pair{files->certificate, "/server.pem"}, std::pair{files->key, "/server.key"}}) {
    std::filesystem::copy_file(from, authority_->folder() + "/new");
    std::filesystem::rename(authority_->folder() + "/new", authority_->folder() + to);
  }
  ClientTls new_ones;
  new_ones.ca_file = others->ca();
  EXPECT_TRUE(Soon([&] { return Work(new_ones).ok(); }));
  EXPECT_EQ(Work(Believing()).code(), absl::StatusCode::kUnavailable);
  EXPECT_TRUE((*open)->ServerInfo().ok()) << "a connection that stood goes on";
}

// New files are shown when all of them are good together, whatever comes first and however broken it is.
TEST_F(AccessTest, ABrokenCertificateIsToldAndTheLastGoodOneStays) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  const std::string certificate = authority_->folder() + "/server.pem", key = authority_->folder() + "/server.key";
  const double expiry = Sample("voxelpipe_certificate_expiry_timestamp_seconds");
  EXPECT_GT(expiry, 0);
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  const auto files = others->Sign("server");
  ASSERT_TRUE(files.ok());
  const auto stays = [&](double failures) {
    EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_reload_failures_total") == failures; }));
    // gRPC looks at what it is given once a second.
    std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    EXPECT_TRUE(Work(Believing()).ok());
    EXPECT_EQ(Sample("voxelpipe_certificate_expiry_timestamp_seconds"), expiry);
  };
  // At once: a file in the middle of its writing would count, too.
  const auto replace = [&](const std::string& from, const std::string& to) {
    std::filesystem::copy_file(from, to + ".new");
    std::filesystem::rename(to + ".new", to);
  };
  std::ofstream(authority_->folder() + "/broken") << "no certificate";
  replace(authority_->folder() + "/broken", certificate);
  stays(1);
  EXPECT_TRUE(Logged("the certificates stay as they were: --tls-cert: ")) << Log();
  replace(files->certificate, certificate);
  stays(2);
  EXPECT_TRUE(Logged("server.key does not belong to the certificate")) << Log();
  replace(files->key, key);
  ClientTls new_ones;
  new_ones.ca_file = others->ca();
  EXPECT_TRUE(Soon([&] { return Work(new_ones).ok(); }));
  EXPECT_EQ(Sample("voxelpipe_reloads_total"), 1);
}

// Good files are not forgotten because there was no descriptor for their copies just then.
TEST_F(AccessTest, ACertificateIsTriedAgainUntilThereAreDescriptorsForIt) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  const auto others = CertificateAuthority::Make();
  ASSERT_TRUE(others.ok());
  const auto files = others->Sign("server");
  ASSERT_TRUE(files.ok());
  SettledProcessFacts(server_->pid());
  // One more, which reads the files; their copies need two.
  const std::string folder = "/proc/" + std::to_string(server_->pid()) + "/fd/";
  rlim_t numbers = 0;
  for (int unused = 0; unused < 2; ++numbers)
    unused += std::filesystem::is_symlink(folder + std::to_string(numbers)) ? 0 : 1;
  rlimit before{};
  ASSERT_EQ(prlimit(server_->pid(), RLIMIT_NOFILE, nullptr, &before), 0);
  const rlimit tight{numbers - 1, before.rlim_max};
  ASSERT_EQ(prlimit(server_->pid(), RLIMIT_NOFILE, &tight, nullptr), 0);
  for (const auto& [from, to] : {std::pair{files->certificate, "/server.pem"}, std::pair{files->key, "/server.key"}}) {
    std::filesystem::copy_file(from, authority_->folder() + "/new");
    std::filesystem::rename(authority_->folder() + "/new", authority_->folder() + to);
  }
  EXPECT_TRUE(Logged("the certificates stay as they were: no descriptors or memory for the certificates")) << Log();
  ASSERT_EQ(prlimit(server_->pid(), RLIMIT_NOFILE, &before, nullptr), 0);
  ClientTls new_ones;
  new_ones.ca_file = others->ca();
  EXPECT_TRUE(Soon([&] { return Work(new_ones).ok(); })) << Log();
}

TEST_F(AccessTest, AProbeNeedsNeitherNameNorToken) {
  ASSERT_NO_FATAL_FAILURE(StartWithTls());
  const std::string folder = authority_->folder();
  const auto probe = [&](const std::string& address) {
    const auto run =
        RunVoxelpiped({"--probe", address, "--tls-cert", folder + "/server.pem", "--tls-key", folder + "/server.key"});
    return run.ok() ? run->exit_code : -1;
  };
  EXPECT_EQ(probe(server_->address()), 0);
  EXPECT_EQ(probe("http://" + http_), 0);
  server_->Signal(SIGKILL);
  ASSERT_TRUE(server_->Wait().ok());
  EXPECT_EQ(probe("http://" + http_), 1);
}

class TokenTest : public AccessTest {
 protected:
  void Write(const std::string& clients) {
    std::ofstream(Path() + ".new") << "{\"clients\": [" << clients << "]}";
    std::filesystem::rename(Path() + ".new", Path());
  }
  std::string Path() const { return authority_->folder() + "/tokens.json"; }
  void StartWithTokens(const std::string& clients, const std::vector<std::string>& more = {}) {
    Write(clients);
    std::vector<std::string> arguments = {"--token-file", Path()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Start(arguments);
  }
};

constexpr char kFarm[] = R"({"name": "farm", "role": "user", "token": "token-of-the-farm"})";
constexpr char kEye[] = R"({"name": "eye", "role": "monitor", "token": "token-of-the-eye"})";

TEST_F(TokenTest, AWrongTokenIsRefusedLoggedAndCounted) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(std::string(kFarm) + "," + kEye));
  EXPECT_TRUE(Work(std::nullopt, "token-of-the-farm").ok()) << Work(std::nullopt, "token-of-the-farm");
  EXPECT_EQ(Work(std::nullopt, "token-of-a-stranger").code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(Refused("bad_token"), 1);
  EXPECT_EQ(Work(std::nullopt).code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(Refused("no_token"), 1);
  const absl::Status role = Work(std::nullopt, "token-of-the-eye");
  EXPECT_EQ(role.code(), absl::StatusCode::kPermissionDenied) << role;
  EXPECT_EQ(Refused("role"), 1);
  EXPECT_TRUE(Logged("code=UNAUTHENTICATED")) << Log();
  EXPECT_TRUE(Logged("code=PERMISSION_DENIED")) << Log();
  EXPECT_TRUE(Logged("client=farm code=OK")) << Log();
  EXPECT_EQ(Log().find("token-of-"), std::string::npos) << "no token is ever logged";
}

TEST_F(TokenTest, ACertificateCountsForATokenWhereItsNameStandsInTheFile) {
  const auto known = authority_->Sign("client"), other = authority_->Sign("other");
  ASSERT_TRUE(known.ok() && other.ok());
  Write(
      R"({"name": "farm", "role": "user", "certificate": ["client.test"], "calls_per_second": 0.01, "burst_calls": 1})"
      R"(,{"name": "eye", "role": "monitor", "token": "token-of-the-eye"})");
  ASSERT_NO_FATAL_FAILURE(
      StartWithTls({"--tls-client-ca", authority_->ca(), "--tls-client-names", "true", "--token-file", Path()}));
  EXPECT_TRUE(Work(Showing(*known)).ok());
  EXPECT_TRUE(Logged("client=farm code=OK")) << Log();
  EXPECT_EQ(Work(Showing(*known)).code(), absl::StatusCode::kResourceExhausted) << "the quota is its own";
  EXPECT_EQ(Refused("quota_rate"), 1);
  const absl::Status stranger = Work(Showing(*other));
  EXPECT_EQ(stranger.code(), absl::StatusCode::kUnauthenticated) << stranger;
  EXPECT_THAT(std::string(stranger.message()), HasSubstr("other.test"));
  EXPECT_EQ(Work(Showing(*known), "token-of-the-eye").code(), absl::StatusCode::kPermissionDenied)
      << "a token goes before a certificate";
}

TEST_F(TokenTest, CertificatesNameNobodyUnlessTheOperatorSaysSo) {
  const auto files = authority_->Sign("client");
  ASSERT_TRUE(files.ok());
  Write(R"({"name": "farm", "role": "user", "certificate": "client.test"})");
  ASSERT_NO_FATAL_FAILURE(StartWithTls({"--tls-client-ca", authority_->ca(), "--token-file", Path()}));
  EXPECT_EQ(Work(Showing(*files)).code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(TokenTest, AUserForgetsItsOwnMeshesAndNotThoseOfOthers) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(std::string(kFarm) +
                                          R"(,{"name": "mill", "role": "user", "token": "token-of-the-mill"})"
                                          R"(,{"name": "boss", "role": "admin", "token": "token-of-the-boss"})"));
  const auto farm = Connect(std::nullopt, "token-of-the-farm"), mill = Connect(std::nullopt, "token-of-the-mill"),
             boss = Connect(std::nullopt, "token-of-the-boss");
  ASSERT_TRUE(farm.ok() && mill.ok() && boss.ok());
  const JobContext job;
  for (const auto* owner : {&farm, &boss}) {
    const auto mesh = (*farm)->UploadMesh(TorusGlb(6), MeshFormat::kGlb, job);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    for (const absl::Status& refused :
         {(*mill)->ReleaseMesh(mesh->name).status(), (*mill)->DeleteMesh(mesh->name).status()}) {
      EXPECT_EQ(refused.code(), absl::StatusCode::kPermissionDenied) << refused;
    }
    const absl::Status gone =
        owner == &boss ? (*boss)->DeleteMesh(mesh->name).status() : (*farm)->ReleaseMesh(mesh->name).status();
    EXPECT_TRUE(gone.ok()) << gone;
  }
}

TEST_F(TokenTest, AMonitorSeesHealthAndServerInfo) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(kEye, {"--open-health", "false"}));
  const auto monitor = Connect(std::nullopt, "token-of-the-eye"), stranger = Connect(std::nullopt);
  ASSERT_TRUE(monitor.ok() && stranger.ok());
  EXPECT_TRUE((*monitor)->ServerInfo().ok());
  EXPECT_TRUE((*monitor)->CheckHealth().ok());
  EXPECT_EQ((*stranger)->ServerInfo().status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ((*stranger)->CheckHealth().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(TokenTest, HealthIsOpenByDefault) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(kEye));
  const auto stranger = Connect(std::nullopt);
  ASSERT_TRUE(stranger.ok());
  EXPECT_TRUE((*stranger)->CheckHealth().ok());
}

TEST_F(TokenTest, TokensAreReadAgainOnSighupAndABadFileChangesNothing) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(kFarm, {"--reload-interval-ms", "86400000"}));
  Write(std::string(kEye) + R"(,{"name": "farm", "role": "user", "token": "new-token-of-the-farm"})");
  EXPECT_TRUE(Work(std::nullopt, "token-of-the-farm").ok());
  server_->Signal(SIGHUP);
  EXPECT_TRUE(Soon([&] { return Work(std::nullopt, "new-token-of-the-farm").ok(); }));
  EXPECT_EQ(Work(std::nullopt, "token-of-the-farm").code(), absl::StatusCode::kUnauthenticated);
  Write("half a fi");
  server_->Signal(SIGHUP);
  EXPECT_TRUE(Soon([&] { return Sample("voxelpipe_reload_failures_total") == 1; }));
  EXPECT_TRUE(Work(std::nullopt, "new-token-of-the-farm").ok());
}

TEST_F(TokenTest, AChangedTokenFileIsNoticed) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(kEye, {"--reload-interval-ms", "100"}));
  EXPECT_EQ(Work(std::nullopt, "token-of-the-farm").code(), absl::StatusCode::kUnauthenticated);
  Write(kFarm);
  EXPECT_TRUE(Soon([&] { return Work(std::nullopt, "token-of-the-farm").ok(); }));
}

TEST_F(TokenTest, BeyondItsQuotaAClientIsToldWhenToComeAgain) {
  ASSERT_NO_FATAL_FAILURE(StartWithTokens(
      R"({"name": "farm", "role": "user", "token": "token-of-the-farm", "calls_per_second": 0.01, "burst_calls": 1},
         {"name": "mill", "role": "user", "token": "token-of-the-mill"})"));
  const auto channel = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
  const auto stub = v1::VoxelizationService::NewStub(channel);
  const auto ask = [&](const char* token) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    context.AddMetadata("authorization", std::string("Bearer ") + token);
    v1::ListShadersResponse response;
    return stub->ListShaders(&context, {}, &response);
  };
  EXPECT_TRUE(ask("token-of-the-farm").ok());
  const grpc::Status status = ask("token-of-the-farm");
  ASSERT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  google::rpc::RetryInfo retry;
  google::rpc::QuotaFailure quota;
  for (const auto& detail : details.details()) {
    if (detail.Is<google::rpc::RetryInfo>()) detail.UnpackTo(&retry);
    if (detail.Is<google::rpc::QuotaFailure>()) detail.UnpackTo(&quota);
  }
  EXPECT_GT(retry.retry_delay().seconds(), 90);
  EXPECT_LE(retry.retry_delay().seconds(), 100);
  ASSERT_EQ(quota.violations_size(), 1);
  EXPECT_EQ(quota.violations(0).subject(), "client:farm");
  EXPECT_EQ(Refused("quota_rate"), 1);
  EXPECT_TRUE(ask("token-of-the-mill").ok()) << "others have their own";
}

// A client that waits for each answer never has two calls at once, however late the server is done with the one before.
TEST_F(TokenTest, OneCallAfterAnotherIsOneAtATime) {
  ASSERT_NO_FATAL_FAILURE(
      StartWithTokens(R"({"name": "farm", "role": "user", "token": "token-of-the-farm", "calls_at_once": 1})"));
  const auto client = Connect(std::nullopt, "token-of-the-farm");
  ASSERT_TRUE(client.ok()) << client.status();
  const std::vector<uint8_t> glb = TorusGlb(6);
  VoxelizeRequest large = SmallRequest();
  large.grid.resolution = 300;  // more than fits into one message
  for (int i = 0; i < 60; ++i) {
    const JobContext job;
    const absl::Status status =
        (*client)->Voxelize(glb, MeshFormat::kGlb, i % 3 == 0 ? large : SmallRequest(), job).status();
    ASSERT_TRUE(status.ok()) << "call " << i << ": " << status;
    ASSERT_TRUE((*client)->ServerInfo().ok()) << "after call " << i;
  }
  EXPECT_EQ(Refused("quota_calls"), 0);
}

TEST_F(TokenTest, MeshBytesHaveAQuota) {
  ASSERT_NO_FATAL_FAILURE(
      StartWithTokens(R"({"name": "farm", "role": "user", "token": "token-of-the-farm", "bytes_per_second": 10})"));
  EXPECT_TRUE(Work(std::nullopt, "token-of-the-farm").ok()) << "the first one is taken whole";
  const absl::Status second = Work(std::nullopt, "token-of-the-farm");
  EXPECT_EQ(second.code(), absl::StatusCode::kResourceExhausted) << second;
  EXPECT_EQ(Refused("quota_bytes"), 1);
}

}  // namespace
}  // namespace voxelpipe::testing
