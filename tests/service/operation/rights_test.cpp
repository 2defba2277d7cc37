// What clients may do to each other, and what they may not.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <fstream>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "gmock/gmock.h"
#include "google/rpc/error_details.pb.h"
#include "gtest/gtest.h"
#include "service/support/effort.h"
#include "service/support/http_get.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/temporary_directory.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// A server with two users, a limited one, a monitor and an administrator; each one's token is "token-of-the-NAME".
class RightsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto client = [](const std::string& name, const std::string& role, const std::string& more = "") {
      return R"({"name": ")" + name + R"(", "role": ")" + role + R"(", "token": "token-of-the-)" + name + "\"" + more +
             "}";
    };
    std::ofstream(folder_ + "/tokens.json")
        << R"({"clients": [)" << client("farm", "user") << "," << client("mill", "user") << ","
        << client("few", "user", R"(, "calls_per_second": 0.001, "burst_calls": 4)") << "," << client("eye", "monitor")
        << "," << client("boss", "admin") << "]}";
  }

  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--token-file", folder_ + "/tokens.json", "--http-listen", "127.0.0.1:0"});
    server_ = StartServer(arguments, folder_ + "/server.log");
    ASSERT_NE(server_, nullptr);
    stub_ = StubOf(*server_);
  }
  std::unique_ptr<Client> As(const std::string& name) {
    ConnectOptions options;
    options.timeout = kPatience;
    options.token = "token-of-the-" + name;
    options.retries = 0;
    auto client = Client::Connect(server_->address(), options);
    EXPECT_TRUE(client.ok()) << client.status();
    return client.ok() ? *std::move(client) : nullptr;
  }
  static void Set(grpc::ClientContext& context, const std::string& name) {
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    context.AddMetadata("authorization", "Bearer token-of-the-" + name);
  }

  std::string Upload(Client& client, const std::vector<uint8_t>& bytes) {
    const JobContext job;
    const auto mesh = client.UploadMesh(bytes, MeshFormat::kAuto, job);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.ok() ? mesh->name : "";
  }
  // UploadMesh of all bytes, whatever the server has: the client library names the mesh first, and sends nothing of one
  // that is there.
  std::string Send(const std::string& client, const std::vector<uint8_t>& bytes) {
    grpc::ClientContext context;
    Set(context, client);
    v1::Mesh response;
    const auto stream = stub_->UploadMesh(&context, &response);
    v1::UploadMeshRequest message;
    message.mutable_upload();
    stream->Write(message);
    message.set_piece(bytes.data(), bytes.size());
    stream->Write(message);
    stream->WritesDone();
    const absl::Status status = FromGrpcStatus(stream->Finish());
    EXPECT_TRUE(status.ok()) << status;
    return response.name();
  }
  // UploadMesh of a name alone.
  absl::Status Name(const std::string& client, const std::string& name, v1::Mesh& response) {
    grpc::ClientContext context;
    Set(context, client);
    const auto stream = stub_->UploadMesh(&context, &response);
    v1::UploadMeshRequest message;
    message.mutable_upload()->set_expected_id(name);
    stream->Write(message);
    stream->WritesDone();
    return FromGrpcStatus(stream->Finish());
  }
  absl::Status Release(const std::string& client, const std::string& name, v1::ReleaseMeshResponse& response) {
    grpc::ClientContext context;
    Set(context, client);
    v1::ReleaseMeshRequest request;
    request.set_name(name);
    return FromGrpcStatus(stub_->ReleaseMesh(&context, request, &response));
  }
  absl::Status Delete(const std::string& client, const std::string& name, v1::DeleteMeshResponse& response) {
    grpc::ClientContext context;
    Set(context, client);
    v1::DeleteMeshRequest request;
    request.set_name(name);
    return FromGrpcStatus(stub_->DeleteMesh(&context, request, &response));
  }
  // The names of all meshes that a client sees, by pages of two.
  std::vector<std::string> List(const std::string& client) {
    std::vector<std::string> names;
    v1::ListMeshesRequest request;
    request.set_page_size(2);
    do {
      grpc::ClientContext context;
      Set(context, client);
      v1::ListMeshesResponse page;
      const grpc::Status status = stub_->ListMeshes(&context, request, &page);
      EXPECT_TRUE(status.ok()) << status.error_message();
      for (const v1::Mesh& mesh : page.meshes()) names.push_back(mesh.name());
      request.set_page_token(page.next_page_token());
    } while (!request.page_token().empty());
    return names;
  }

  const TemporaryDirectory directory_;
  const std::string folder_ = directory_.path().string();
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

TEST_F(RightsTest, NamingAMeshGivesItsUseAndNoClaim) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto boss = As("boss"), farm = As("farm"), mill = As("mill");
  ASSERT_TRUE(boss && farm && mill);
  const JobContext job;
  for (Client* owner : {boss.get(), farm.get()}) {
    const std::string name = Upload(*owner, TorusGlb(owner == farm.get() ? 7 : 6));
    v1::Mesh named;
    ASSERT_TRUE(Name("mill", name, named).ok());
    EXPECT_TRUE(named.already_stored());
    EXPECT_EQ(named.name(), name);
    EXPECT_TRUE(mill->VoxelizeStored(name, SmallRequest(), job).ok());
    v1::ReleaseMeshResponse released;
    const absl::Status refused = Release("mill", name, released);
    EXPECT_TRUE(absl::IsPermissionDenied(refused)) << refused;
    EXPECT_THAT(List("mill"), IsEmpty());
    EXPECT_TRUE(owner->GetMesh(name).ok()) << "it is still there";
  }
}

TEST_F(RightsTest, AnAdministratorsMeshOutlivesAUsersClaim) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto boss = As("boss");
  ASSERT_TRUE(boss);
  const std::string name = Upload(*boss, TorusGlb(6));
  ASSERT_EQ(Send("mill", TorusGlb(6)), name);
  v1::ReleaseMeshResponse released;
  ASSERT_TRUE(Release("mill", name, released).ok());
  EXPECT_TRUE(released.kept_for_others());
  EXPECT_TRUE(boss->GetMesh(name).ok());
}

TEST_F(RightsTest, AReleaseThatLeavesTheMeshToOthersSaysSo) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto farm = As("farm"), mill = As("mill");
  ASSERT_TRUE(farm && mill);
  const std::string name = Upload(*farm, TorusGlb(6));
  ASSERT_EQ(Send("mill", TorusGlb(6)), name);
  v1::ReleaseMeshResponse first, again, last;
  ASSERT_TRUE(Release("farm", name, first).ok());
  EXPECT_TRUE(first.kept_for_others());
  EXPECT_EQ(first.freed_bytes(), 0);
  EXPECT_TRUE(mill->GetMesh(name).ok());
  EXPECT_TRUE(absl::IsPermissionDenied(Release("farm", name, again))) << "its claim is gone";
  ASSERT_TRUE(Release("mill", name, last).ok());
  EXPECT_FALSE(last.kept_for_others());
  EXPECT_GT(last.freed_bytes(), 0);
  EXPECT_TRUE(absl::IsNotFound(mill->GetMesh(name).status()));
}

TEST_F(RightsTest, AnAdministratorsDeleteNeedsNoClaim) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto farm = As("farm");
  ASSERT_TRUE(farm);
  const std::string name = Upload(*farm, TorusGlb(6));
  ASSERT_EQ(Send("mill", TorusGlb(6)), name);
  v1::ReleaseMeshResponse released;
  EXPECT_TRUE(absl::IsPermissionDenied(Release("boss", name, released))) << "a release does";
  v1::DeleteMeshResponse deleted;
  ASSERT_TRUE(Delete("boss", name, deleted).ok());
  EXPECT_GT(deleted.freed_bytes(), 0);
  EXPECT_TRUE(absl::IsNotFound(farm->GetMesh(name).status())) << "whatever claims it has";
  EXPECT_TRUE(absl::IsNotFound(Delete("boss", name, deleted)));
}

TEST_F(RightsTest, OnlyAnAdministratorDeletes) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto farm = As("farm");
  ASSERT_TRUE(farm);
  const std::string name = Upload(*farm, TorusGlb(6));
  v1::DeleteMeshResponse deleted;
  // Not even its own; the answer does not say what there is.
  for (const std::string& any : {name, "meshes/" + std::string(64, 'a'), std::string("no name")}) {
    for (const char* client : {"farm", "mill", "eye"}) {
      const absl::Status refused = Delete(client, any, deleted);
      EXPECT_TRUE(absl::IsPermissionDenied(refused)) << client << " " << any << ": " << refused;
    }
  }
  EXPECT_TRUE(farm->GetMesh(name).ok());
  v1::ReleaseMeshResponse released;
  EXPECT_TRUE(absl::IsPermissionDenied(Release("eye", name, released))) << "a monitor has no meshes";
}

TEST_F(RightsTest, AListHasTheOwnClaimsAndOfAnAdministratorAll) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<std::string> names;
  for (int i = 0; i < 5; ++i) names.push_back(Send(i % 2 == 0 ? "farm" : "mill", TorusGlb(6 + i)));
  ASSERT_EQ(Send("mill", TorusGlb(6)), names[0]);  // both have a claim on the oldest
  EXPECT_THAT(List("farm"), ElementsAre(names[4], names[2], names[0]));
  EXPECT_THAT(List("mill"), ElementsAre(names[3], names[1], names[0]));
  EXPECT_THAT(List("boss"), ElementsAre(names[4], names[3], names[2], names[1], names[0]));
  v1::ReleaseMeshResponse released;
  ASSERT_TRUE(Release("farm", names[0], released).ok());
  ASSERT_TRUE(Release("farm", names[4], released).ok());
  EXPECT_THAT(List("farm"), ElementsAre(names[2]));
  EXPECT_THAT(List("mill"), ElementsAre(names[3], names[1], names[0]));
  EXPECT_THAT(List("boss"), ElementsAre(names[3], names[2], names[1], names[0]));
  grpc::ClientContext context;
  Set(context, "eye");
  v1::ListMeshesResponse page;
  EXPECT_EQ(stub_->ListMeshes(&context, {}, &page).error_code(), grpc::StatusCode::PERMISSION_DENIED);
}

TEST_F(RightsTest, JobsOfAStreamCountAsCallsDo) {
  ASSERT_NO_FATAL_FAILURE(Start());
  grpc::ClientContext context;
  Set(context, "few");
  const auto stream = stub_->VoxelizeBatch(&context);
  v1::VoxelizeBatchRequest all;
  for (uint64_t id = 1; id <= 7; ++id) *all.add_jobs() = JobOf(id, RequestOf(SmallRequest(), TorusGlb(6)));
  ASSERT_TRUE(stream->Write(all));
  stream->WritesDone();
  std::map<uint64_t, Received> jobs;
  for (v1::VoxelizeBatchResponse response; stream->Read(&response);) Add(response, jobs);
  EXPECT_TRUE(stream->Finish().ok()) << "the stream goes on";
  int done = 0, refused = 0;
  for (const auto& [id, job] : jobs) {
    if (job.in_one_message) ++done;
    if (job.status.ok()) continue;
    ++refused;
    EXPECT_EQ(job.status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(ReasonOf(job.status), "QUOTA_EXCEEDED");
    EXPECT_GT(DetailOf<google::rpc::RetryInfo>(job.status).retry_delay().seconds(), 0);
    EXPECT_EQ(DetailOf<google::rpc::QuotaFailure>(job.status).violations(0).subject(), "client:few");
  }
  EXPECT_EQ(done, 4) << "as many as there are calls at once";
  EXPECT_EQ(refused, 3);

  grpc::ClientContext single;
  Set(single, "few");
  v1::ListShadersResponse shaders;
  EXPECT_EQ(stub_->ListShaders(&single, {}, &shaders).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED)
      << "single calls have the same quota";
}

TEST_F(RightsTest, OthersUploadsLeaveAClientItsShareOfTheStore) {
  ASSERT_NO_FATAL_FAILURE(Start());
  std::vector<std::vector<uint8_t>> files(12, TorusGlb(12));
  for (size_t i = 0; i < files.size(); ++i) files[i].back() = uint8_t('a' + i);  // of the PNG's last bytes
  uint64_t each = 0;
  {
    const auto farm = As("farm");
    ASSERT_TRUE(farm);
    const JobContext job;
    const auto mesh = farm->UploadMesh(files[0], MeshFormat::kGlb, job);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    each = mesh->memory_bytes;
  }
  ASSERT_NO_FATAL_FAILURE(Start({"--max-mesh-store-bytes", std::to_string(each * 4 + each / 2)}));
  const auto farm = As("farm"), mill = As("mill");
  ASSERT_TRUE(farm && mill);
  const std::string first = Upload(*farm, files[0]), second = Upload(*farm, files[1]);
  std::vector<std::string> ids;
  for (size_t i = 2; i < files.size(); ++i) ids.push_back(Upload(*mill, files[i]));
  EXPECT_TRUE(farm->GetMesh(first).ok());
  EXPECT_TRUE(farm->GetMesh(second).ok());
  EXPECT_TRUE(mill->GetMesh(ids.back()).ok()) << "the other has the rest";
  EXPECT_TRUE(absl::IsNotFound(mill->GetMesh(ids.front()).status()));
}

// One worker, a job that holds it, more of the first client's that wait, and the same request of both clients behind
// all of them.
TEST_F(RightsTest, AnEqualRequestGetsTheBestPlaceOfAllThatWait) {
  ASSERT_NO_FATAL_FAILURE(
      Start({"--workers", "1", "--threads", "1", "--backend", "cpu", "--giant-job-ms", "100000000"}));
  const auto farm = As("farm"), mill = As("mill");
  ASSERT_TRUE(farm && mill);
  const std::string name = Upload(*farm, LargeTrianglesGlb(LessIfSlow(300)));
  const std::string endless = Upload(*farm, LargeTrianglesGlb(20'000));
  const auto queued = [&] {
    const std::string metrics = HttpGet(*server_->http_address(), "/metrics");
    return SampleOf(metrics, "voxelpipe_queue_jobs{priority=\"normal\"}") +
           SampleOf(metrics, "voxelpipe_queue_jobs{priority=\"high\"}") +
           SampleOf(metrics, "voxelpipe_queue_jobs{priority=\"low\"}");
  };
  const auto wait_for = [&](const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!condition() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(milliseconds(5));
    return condition();
  };
  JobContext holding;
  std::promise<void> holds;
  auto holder = std::async(std::launch::async, [&] {
    return farm->VoxelizeStored(endless, SlowRequest(), holding, {}, [&](const Plan&) { holds.set_value(); }).status();
  });
  ASSERT_EQ(holds.get_future().wait_for(kPatience), std::future_status::ready);

  const JobContext job;
  const auto ask = [&](Client& client, int64_t resolution) {
    VoxelizeRequest request = SlowRequest();
    request.grid.resolution = resolution;
    return client.VoxelizeStored(name, request, job);
  };
  std::vector<std::future<absl::StatusOr<RemoteResult>>> others;
  for (int i = 0; i < 5; ++i) others.push_back(std::async(std::launch::async, [&, i] { return ask(*farm, 250 + i); }));
  ASSERT_TRUE(wait_for([&] { return queued() == 5; }));
  auto same = std::async(std::launch::async, [&] { return ask(*farm, 256); });
  ASSERT_TRUE(wait_for([&] { return queued() == 6; }));
  const auto uses = [&] { return mill->GetMesh(name).value_or(StoredMesh{}).uses; };
  const uint64_t uses_before = uses();
  auto joined = std::async(std::launch::async, [&] { return ask(*mill, 256); });
  ASSERT_TRUE(wait_for([&] { return uses() > uses_before; }));
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_EQ(queued(), 6) << "it takes no place of its own";
  holding.Cancel();
  EXPECT_FALSE(holder.get().ok());
  const auto result = joined.get();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(result->cached) << "made for the other one";
  const auto run = same.get();
  ASSERT_TRUE(run.ok()) << run.status();
  // By the server's clock, as threads of this process may wake up late: the others were there first, so those that
  // waited for less time began before it.
  int begun_before = 0;
  for (auto& other : others) {
    const auto ended = other.get();
    ASSERT_TRUE(ended.ok()) << ended.status();
    if (ended->served.queue_ms < run->served.queue_ms) ++begun_before;
  }
  EXPECT_LE(begun_before, 1) << "not behind the jobs of the one who asked first";
}

// The first client's share of the queue is full; the other one asks for the same at the same time.
TEST_F(RightsTest, AnEqualRequestIsNotRefusedForAnothersShare) {
  ASSERT_NO_FATAL_FAILURE(Start(
      {"--workers", "1", "--threads", "1", "--backend", "cpu", "--max-queue", "20", "--giant-job-ms", "100000000"}));
  const auto farm = As("farm"), mill = As("mill");
  ASSERT_TRUE(farm && mill);
  const std::string name = Upload(*farm, LargeTrianglesGlb(20'000));
  std::vector<std::unique_ptr<JobContext>> jobs;
  std::vector<std::future<absl::Status>> calls;
  std::promise<void> holds;
  const auto ask = [&](Client& client, int64_t resolution, const std::function<void(const Plan&)>& on_plan = {}) {
    jobs.push_back(std::make_unique<JobContext>());
    return std::async(std::launch::async, [&, resolution, on_plan, job = jobs.back().get()] {
      VoxelizeRequest request = SlowRequest();
      request.grid.resolution = resolution;
      return client.VoxelizeStored(name, request, *job, {}, on_plan).status();
    });
  };
  calls.push_back(ask(*farm, 256, [&](const Plan&) { holds.set_value(); }));
  ASSERT_EQ(holds.get_future().wait_for(kPatience), std::future_status::ready);
  // Its places are eight ninths; more of its jobs are refused. Of the two that are left the other one needs one: a call
  // that finds none at all is refused before anything of it is read.
  constexpr int kShare = 18;
  for (int i = 0; i < kShare; ++i) calls.push_back(ask(*farm, 200 + i));
  const auto end = std::chrono::steady_clock::now() + kPatience;
  const auto http = server_->http_address();
  ASSERT_TRUE(http.ok());
  while (SampleOf(HttpGet(*http, "/metrics"), "voxelpipe_queue_jobs{priority=\"normal\"}") < kShare &&
         std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(milliseconds(5));
  }
  std::vector<std::future<absl::Status>> refused, taken;
  for (int i = 0; i < 30; ++i) {
    refused.push_back(ask(*farm, 300));
    if (i % 10 == 5) taken.push_back(ask(*mill, 300));
  }
  // Those of the first client that did not join the other's are refused; none of the other's is.
  for (auto& call : taken) {
    EXPECT_EQ(call.wait_for(milliseconds(300)), std::future_status::timeout) << call.get();
  }
  for (const auto& job : jobs) job->Cancel();
  for (auto& call : taken) EXPECT_TRUE(absl::IsCancelled(call.get()));
  for (auto& call : refused) EXPECT_FALSE(call.get().ok());
  for (auto& call : calls) call.get().IgnoreError();
}

TEST_F(RightsTest, ProbesAreAnsweredBesideFiveHundredSlowConnections) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto http = server_->http_address();
  ASSERT_TRUE(http.ok());
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(uint16_t(std::stoi(http->substr(http->rfind(':') + 1))));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::vector<int> slow;
  for (int i = 0; i < 500; ++i) {
    slow.push_back(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(connect(slow.back(), reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    ASSERT_TRUE(i % 2 == 1 || send(slow.back(), "GET /li", 7, MSG_NOSIGNAL) == 7);
  }
  for (const char* path : {"/livez", "/readyz"}) {
    std::vector<milliseconds> times;
    for (int i = 0; i < 5; ++i) {
      for (size_t at = 0; at < slow.size(); at += 2) send(slow[at], "v", 1, MSG_NOSIGNAL);  // byte by byte
      const auto begin = std::chrono::steady_clock::now();
      EXPECT_THAT(HttpGet(*http, path), HasSubstr("200 OK"));
      times.push_back(std::chrono::duration_cast<milliseconds>(std::chrono::steady_clock::now() - begin));
    }
    std::sort(times.begin(), times.end());
    EXPECT_LT(times[2].count(), 200 * kSlowdown) << path;
  }
  for (const int fd : slow) close(fd);
}

TEST_F(RightsTest, ARefusedCallersLineNamesTheClient) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto farm = As("farm"), eye = As("eye");
  ASSERT_TRUE(farm && eye);
  const JobContext job;
  EXPECT_TRUE(absl::IsPermissionDenied(eye->Voxelize(TorusGlb(6), MeshFormat::kGlb, SmallRequest(), job).status()));
  const std::string name = Upload(*farm, TorusGlb(6));
  v1::ReleaseMeshResponse released;
  EXPECT_TRUE(absl::IsPermissionDenied(Release("mill", name, released)));
  v1::DeleteMeshResponse deleted;
  EXPECT_TRUE(absl::IsPermissionDenied(Delete("mill", name, deleted)));
  server_->Signal(SIGTERM);
  ASSERT_TRUE(server_->Wait().ok());
  std::ifstream log(folder_ + "/server.log");
  std::vector<std::string> denied;
  for (std::string line; std::getline(log, line);) {
    if (line.find("code=PERMISSION_DENIED") != std::string::npos) denied.push_back(line);
  }
  ASSERT_EQ(denied.size(), 3u);
  EXPECT_THAT(denied[0], HasSubstr(" client=eye "));
  EXPECT_THAT(denied[1], HasSubstr(" client=mill "));
  EXPECT_THAT(denied[2], HasSubstr(" client=mill "));
}

}  // namespace
}  // namespace voxelpipe::testing
