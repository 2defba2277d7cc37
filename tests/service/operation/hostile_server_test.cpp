// What a server sends does not steer the terminal of its client.
#include <atomic>
#include <chrono>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/grpcpp.h>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/json/json.h"
#include "unit/cli/cli_runner.h"
#include "unit/cli/control_characters.h"
#include "unit/cli/terminal.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using ::testing::HasSubstr;

// Appends kHostileText to every text in a message, but to those that the client checks.
void Spoil(google::protobuf::Message& message) {
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const google::protobuf::FieldDescriptor* field : fields) {
    const int count = field->is_repeated() ? reflection.FieldSize(message, field) : 1;
    for (int i = 0; i < count; ++i) {
      if (field->type() == field->TYPE_MESSAGE) {
        Spoil(field->is_repeated() ? *reflection.MutableRepeatedMessage(&message, field, i)
                                   : *reflection.MutableMessage(&message, field));
      } else if (field->type() == field->TYPE_STRING && field->name() != "content_sha256" &&
                 field->full_name() != "voxelpipe.v1.ResultArray.name") {
        if (field->is_repeated()) {
          reflection.SetRepeatedString(&message, field, i,
                                       reflection.GetRepeatedString(message, field, i) + kHostileText);
        } else {
          reflection.SetString(&message, field, reflection.GetString(message, field) + kHostileText);
        }
      }
    }
  }
}

void AddWarning(google::protobuf::RepeatedPtrField<v1::Warning>& warnings) {
  v1::Warning& warning = *warnings.Add();
  warning.set_code(v1::WARNING_CODE_NONCONFORMING_FILE);
  warning.set_place("place");
  warning.set_text("text");
}

// Passes calls on to a real server, and spoils the answers; or refuses them all.
class HostileServer final : public v1::VoxelizationService::Service {
 public:
  explicit HostileServer(const std::string& real)
      : real_(v1::VoxelizationService::NewStub(grpc::CreateChannel(real, grpc::InsecureChannelCredentials()))) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  std::string target() const { return absl::StrCat("127.0.0.1:", port_); }
  void RefuseAll() { refuse_ = true; }

  grpc::Status GetServerInfo(grpc::ServerContext*, const v1::GetServerInfoRequest* request,
                             v1::GetServerInfoResponse* response) override {
    return PassOn([&](grpc::ClientContext& context) { return real_->GetServerInfo(&context, *request, response); },
                  *response);
  }
  grpc::Status ListShaders(grpc::ServerContext*, const v1::ListShadersRequest* request,
                           v1::ListShadersResponse* response) override {
    return PassOn([&](grpc::ClientContext& context) { return real_->ListShaders(&context, *request, response); },
                  *response);
  }
  grpc::Status EstimateVoxelization(grpc::ServerContext*, const v1::EstimateVoxelizationRequest* request,
                                    v1::EstimateVoxelizationResponse* response) override {
    AddWarning(*response->mutable_warnings());
    const grpc::Status status =
        PassOn([&](grpc::ClientContext& context) { return real_->EstimateVoxelization(&context, *request, response); },
               *response);
    response->mutable_contents()->add_attributes()->set_name("_" + kHostileText);
    AddWarning(*response->mutable_warnings());
    Spoil(*response->mutable_warnings(response->warnings_size() - 1));
    return status;
  }
  grpc::Status Voxelize(grpc::ServerContext*, const v1::VoxelizeRequest* request,
                        grpc::ServerWriter<v1::VoxelizeResponse>* writer) override {
    grpc::ClientContext context;
    const auto reader = real_->Voxelize(&context, *request);
    v1::VoxelizeResponse response;
    response.mutable_progress()->set_stage(kHostileText);
    std::this_thread::sleep_for(
        std::chrono::milliseconds(200));  // the line of progress is not for jobs that end at once
    if (!refuse_) writer->Write(response);
    while (reader->Read(&response)) {
      if (response.has_summary()) AddWarning(*response.mutable_summary()->mutable_warnings());
      Spoil(response);
      if (!refuse_) writer->Write(response);
    }
    return refuse_ ? Refusal() : reader->Finish();
  }

 private:
  static grpc::Status Refusal() { return {grpc::StatusCode::INTERNAL, "refused " + kHostileText}; }
  template <typename Call>
  grpc::Status PassOn(const Call& call, google::protobuf::Message& response) const {
    grpc::ClientContext context;
    const grpc::Status status = call(context);
    Spoil(response);
    return refuse_ ? Refusal() : status;
  }

  std::unique_ptr<v1::VoxelizationService::Stub> real_;
  std::atomic<bool> refuse_ = false;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

class HostileServerTest : public ::testing::Test {
 protected:
  HostileServerTest() : real_(StartServer({"--log-level", "error"})) {
    const std::vector<uint8_t> bytes = TorusGlb(12);
    std::ofstream(directory_ / "torus.glb", std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
    std::ofstream(directory_ / "list.jsonl") << R"({"input": "torus.glb"})"
                                             << "\n";
  }
  // Every command that asks a server, with `server` for its address.
  std::vector<std::vector<std::string>> Commands(const std::string& server) const {
    const std::string mesh = directory_ / "torus.glb";
    return {{"server-info", "--server", server},
            {"server-info", "--json", "--server", server},
            {"shaders", "--server", server},
            {"shaders", "--json", "--server", server},
            {"info", mesh, "--server", server},
            {"info", mesh, "--json", "--server", server},
            {"voxelize", mesh, "--resolution", "8", "--server", server},
            {"voxelize", mesh, "--resolution", "8", "--json", "--progress", "json", "--server", server},
            {"batch", directory_ / "list.jsonl", "--output-dir", directory_ / "out", "--resolution", "8", "--retries",
             "0", "--report", directory_ / "report.json", "--server", server},
            {"bench", mesh, "--resolution", "8", "--duration", "0.1", "--send-mesh", "--server", server},
            {"bench", mesh, "--resolution", "8", "--duration", "0.1", "--send-mesh", "--json", "--server", server}};
  }

  std::unique_ptr<ServerProcess> real_;
  TemporaryDirectory directory_;
};

TEST_F(HostileServerTest, ItsTextsDoNotSteerTheTerminal) {
  ASSERT_NE(real_, nullptr);
  const HostileServer server(real_->address());
  for (const std::vector<std::string>& command : Commands(server.target())) {
    const CliOutcome outcome = RunCli(command);
    EXPECT_EQ(outcome.exit_code, 0) << command[0] << ": " << outcome.err;
    EXPECT_EQ(ControlsIn(outcome.out), "") << command[0] << " " << command[1];
    EXPECT_EQ(ControlsIn(outcome.err), "") << command[0] << " " << command[1];
    EXPECT_TRUE(command[0] == "bench" || (outcome.out + outcome.err).find("title") != std::string::npos) << command[0];
  }
  std::ifstream report(directory_ / "report.json");
  const std::string text{std::istreambuf_iterator<char>(report), {}};
  EXPECT_EQ(ControlsIn(text), "");
  EXPECT_THAT(ParseJson(text)["items"][0]["worker"].get<std::string>(), HasSubstr(kHostileText));
}

TEST_F(HostileServerTest, ItsErrorsDoNotSteerTheTerminal) {
  ASSERT_NE(real_, nullptr);
  HostileServer server(real_->address());
  server.RefuseAll();
  for (const std::vector<std::string>& command : Commands(server.target())) {
    const CliOutcome outcome = RunCli(command);
    EXPECT_NE(outcome.exit_code, 0) << command[0];
    EXPECT_EQ(ControlsIn(outcome.out + outcome.err), "") << command[0] << " " << command[1];
    EXPECT_TRUE(command[0] == "bench" || outcome.err.find("refused ?]0;title") != std::string::npos) << command[0];
  }
}

TEST_F(HostileServerTest, ItsStagesDoNotSteerTheLineOfProgress) {
  ASSERT_NE(real_, nullptr);
  const HostileServer server(real_->address());
  Terminal terminal;
  if (terminal.path().empty()) GTEST_SKIP() << "no pseudo-terminal";
  const CliOutcome outcome =
      RunCli({"voxelize", directory_ / "torus.glb", "--resolution", "8", "--server", server.target()}, "",
             "2>" + terminal.path());
  EXPECT_EQ(outcome.exit_code, 0);
  std::string shown = terminal.Shown();
  // What the line of progress itself uses, and what a terminal makes of a line feed.
  for (const std::string own : {"\r\n", "\r", "\x1b[K"}) {
    for (size_t at; (at = shown.find(own)) != std::string::npos;) shown.erase(at, own.size());
  }
  EXPECT_EQ(ControlsIn(shown), "");
  EXPECT_THAT(shown, HasSubstr("title"));
}

}  // namespace
}  // namespace voxelpipe::testing
