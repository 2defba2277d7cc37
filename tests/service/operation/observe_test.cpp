// What an operator sees of a server: metrics, readiness, log lines, ids, devices.
#include <signal.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "gmock/gmock.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "gtest/gtest.h"
#include "service/support/http_get.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/json/json.h"
#include "support/resources/temporary_directory.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/contract_revision.h"

namespace voxelpipe::testing {
namespace {

using grpc::health::v1::HealthCheckResponse;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::StartsWith;

class ObserveTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--http-listen", "127.0.0.1:0", "--log-format", "json"});
    server_ = StartServer(arguments, log_path_);
    ASSERT_NE(server_, nullptr);
    const auto http = server_->http_address();
    ASSERT_TRUE(http.ok()) << http.status();
    http_ = *http;
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    channel_ = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
  }
  double Sample(const std::string& name) { return SampleOf(HttpGet(http_, "/metrics"), name); }

  // The server's end, and then all lines of its log with that event; every line must be an object of JSON.
  std::vector<nlohmann::json> EventsAfterTheEnd(const std::string& event) {
    server_->Signal(SIGTERM);
    EXPECT_TRUE(server_->Wait().ok());
    std::vector<nlohmann::json> found;
    std::ifstream file(log_path_);
    for (std::string line; std::getline(file, line);) {
      const auto object = ParseJson(line, false);
      EXPECT_TRUE(object.is_object()) << line;
      if (object.is_object() && object.value("event", "") == event) found.push_back(object);
    }
    return found;
  }

  const TemporaryDirectory directory_;
  const std::string log_path_ = directory_ / "server.log";
  std::string http_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::shared_ptr<grpc::Channel> channel_;
};

TEST_F(ObserveTest, ACallIsSeenInTheMetrics) {
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cpu"}));
  const JobContext job;
  const std::vector<uint8_t> mesh = TorusGlb(6);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(client_->Voxelize(mesh, MeshFormat::kGlb, SmallRequest(), job).ok());
  EXPECT_FALSE(client_->Voxelize({mesh.data(), 10}, MeshFormat::kGlb, SmallRequest(), job).ok());
  // A call counts when gRPC is done with it, a moment after its client.
  const std::string total = "voxelpipe_calls_total{code=\"OK\",method=\"Voxelize\"}";
  for (int i = 0;
       i < 500 && Sample(total) + Sample("voxelpipe_calls_total{code=\"INVALID_ARGUMENT\",method=\"Voxelize\"}") < 4;
       ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(Sample(total), 3);
  EXPECT_EQ(Sample("voxelpipe_calls_total{code=\"INVALID_ARGUMENT\",method=\"Voxelize\"}"), 1);
  EXPECT_EQ(Sample("voxelpipe_calls_in_flight{method=\"Voxelize\"}"), 0);
  EXPECT_EQ(Sample("voxelpipe_call_seconds_count{method=\"Voxelize\"}"), 4);
  EXPECT_EQ(Sample("voxelpipe_received_bytes_total"), 3 * double(mesh.size()) + 10);
  EXPECT_GT(Sample("voxelpipe_sent_bytes_total"), 0);
  EXPECT_EQ(Sample("voxelpipe_jobs_total{code=\"OK\"}"), 3);
  EXPECT_EQ(Sample("voxelpipe_job_seconds_count"), 3);
  EXPECT_EQ(Sample("voxelpipe_stage_seconds_count{stage=\"load\"}"), 3);
  EXPECT_EQ(Sample("voxelpipe_device_serving{device=\"cpu\"}"), 1);
  EXPECT_GE(Sample("voxelpipe_device_jobs_total{device=\"cpu\"}"), 3);
  EXPECT_EQ(Sample("voxelpipe_memory_bytes{budget=\"uploads\"}"), 0);
  EXPECT_GT(Sample("voxelpipe_memory_limit_bytes{budget=\"working\"}"), 0);
  EXPECT_GT(Sample("process_resident_memory_bytes"), 1e6);
}

TEST_F(ObserveTest, ReadinessEndsWithTheDrainAndMetricsDoNot) {
  ASSERT_NO_FATAL_FAILURE(Start({"--lame-duck-ms", "3000"}));
  EXPECT_THAT(HttpGet(http_, "/readyz"), StartsWith("HTTP/1.1 200"));
  server_->Signal(SIGTERM);
  std::string answer;
  for (int i = 0; i < 250; ++i) {
    answer = HttpGet(http_, "/readyz");
    if (!answer.starts_with("HTTP/1.1 200")) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 503"));
  EXPECT_THAT(HttpGet(http_, "/livez"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(HttpGet(http_, "/metrics"), HasSubstr("voxelpipe_build_info"));
  const auto end = server_->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(ObserveTest, ACallHasOneLineWithItsIdAndItsCallersTrace) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto stub = v1::VoxelizationService::NewStub(channel_);
  const auto ask = [&](const char* id, const char* trace) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    if (id != nullptr) context.AddMetadata("x-request-id", id);
    if (trace != nullptr) context.AddMetadata("traceparent", trace);
    v1::ListShadersResponse response;
    EXPECT_TRUE(stub->ListShaders(&context, {}, &response).ok());
    const auto& metadata = context.GetServerInitialMetadata();
    const auto found = metadata.find("x-request-id");
    return found == metadata.end() ? std::string() : std::string(found->second.data(), found->second.size());
  };
  EXPECT_EQ(ask("frame-17", "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"), "frame-17");
  const std::string own = ask("not \"valid\"", "neither is this");
  EXPECT_THAT(own, MatchesRegex("[0-9a-f]{8}-[0-9]+"));
  const JobContext job;
  ASSERT_TRUE(client_->Voxelize(TorusGlb(6), MeshFormat::kGlb, SmallRequest(), job).ok());

  const std::vector<nlohmann::json> calls = EventsAfterTheEnd("call");
  ASSERT_EQ(calls.size(), 3u);
  EXPECT_EQ(calls[0].value("request", ""), "frame-17");
  EXPECT_EQ(calls[0].value("method", ""), "ListShaders");
  EXPECT_EQ(calls[0].value("trace_id", ""), "4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_EQ(calls[0].value("span_id", ""), "00f067aa0ba902b7");
  EXPECT_EQ(calls[1].value("request", ""), own);
  EXPECT_FALSE(calls[1].contains("trace_id"));
  const nlohmann::json& work = calls[2];
  EXPECT_EQ(work.value("method", ""), "Voxelize");
  EXPECT_EQ(work.value("code", ""), "OK");
  EXPECT_EQ(work.value("triangles", 0), 72);
  EXPECT_EQ(work.value("in", size_t{0}), TorusGlb(6).size());
  for (const char* key : {"peer", "worker", "dims", "time", "level"}) {
    EXPECT_TRUE(work.contains(key) && work[key].is_string() && !work[key].get<std::string>().empty()) << key;
  }
  for (const char* key : {"ms", "queue_ms", "batch", "out", "voxelize_ms"}) {
    EXPECT_TRUE(work.contains(key) && work[key].is_number()) << key;
  }
}

TEST_F(ObserveTest, HealthKnowsEveryDevice) {
  ASSERT_NO_FATAL_FAILURE(Start({"--backend", "cpu"}));
  const auto health = grpc::health::v1::Health::NewStub(channel_);
  const auto check = [&](const std::string& name, HealthCheckResponse& response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    grpc::health::v1::HealthCheckRequest request;
    request.set_service(name);
    return health->Check(&context, request, &response);
  };
  HealthCheckResponse response;
  const grpc::Status status = check("device/cpu", response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(response.status(), HealthCheckResponse::SERVING);
  EXPECT_EQ(check("device/cuda:77", response).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(check("cpu", response).error_code(), grpc::StatusCode::NOT_FOUND);
  v1::GetServerInfoResponse info;
  grpc::ClientContext context;
  ASSERT_TRUE(v1::VoxelizationService::NewStub(channel_)->GetServerInfo(&context, {}, &info).ok());
  ASSERT_EQ(info.devices_size(), 1);
  EXPECT_EQ(info.devices(0).name(), "cpu");
  EXPECT_EQ(info.devices(0).state(), v1::DEVICE_STATE_SERVING);
  EXPECT_EQ(info.devices(0).backend(), v1::BACKEND_CPU);
  EXPECT_EQ(info.contract_revision(), kContractRevision);
}

TEST(CheckConfigTest, ItSaysWhatIsWrong) {
  EXPECT_EQ(RunVoxelpiped({"--check-config"})->exit_code, 0);
  EXPECT_THAT(RunVoxelpiped({"--check-config", "--threads", "3"})->output, HasSubstr("threads = 3  # flag\n"));
  for (const std::vector<std::string>& wrong : {std::vector<std::string>{"--token-file", "/nowhere"},
                                                {"--tls-cert", "/nowhere"},
                                                {"--tls-cert", "/nowhere", "--tls-key", "/nowhere"},
                                                {"--tls-client-ca", "/nowhere"},
                                                {"--threads", "many"}}) {
    std::vector<std::string> arguments = {"--check-config"};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    const auto run = RunVoxelpiped(arguments);
    ASSERT_TRUE(run.ok()) << run.status();
    EXPECT_EQ(run->exit_code, 2) << wrong[0] << " " << wrong[1];
  }
}

TEST(OperationsTest, EveryOptionOfHelpStandsInTheTable) {
  const auto help = RunVoxelpiped({"--help"});
  ASSERT_TRUE(help.ok()) << help.status();
  std::ifstream file(VOXELPIPE_OPERATIONS_MD);
  const std::string table{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  ASSERT_FALSE(table.empty());
  std::istringstream lines(help->output);
  int options = 0;
  for (std::string line; std::getline(lines, line);) {
    const size_t begin = line.find("--");
    if (begin == std::string::npos || line.find_first_not_of(" ,-h") < begin || begin > 5) continue;
    const std::string flag = line.substr(begin, line.find_first_of(" ,", begin) - begin);
    if (flag == "--help" || flag == "--version") continue;
    ++options;
    EXPECT_THAT(table, HasSubstr("| `" + flag + "` |")) << "is not in server/OPERATIONS.md";
  }
  EXPECT_GT(options, 25);
}

TEST(OperationsTest, EveryMetricStandsInTheList) {
  const auto server = StartServer({"--http-listen", "127.0.0.1:0", "--log-level", "off"});
  ASSERT_NE(server, nullptr);
  const auto http = server->http_address();
  ASSERT_TRUE(http.ok());
  std::ifstream file(VOXELPIPE_OPERATIONS_MD);
  const std::string list{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  std::istringstream lines(HttpGet(*http, "/metrics"));
  int metrics = 0;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("# TYPE ")) continue;
    std::istringstream words(line);
    std::string name;
    words >> name >> name >> name;
    ++metrics;
    EXPECT_THAT(list, HasSubstr("| `" + name + "` |")) << "is not in server/OPERATIONS.md";
  }
  EXPECT_GT(metrics, 40);
}

}  // namespace
}  // namespace voxelpipe::testing
