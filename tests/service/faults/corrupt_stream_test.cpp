// Bytes that are no call, calls that are no messages, messages that make no sense: refused, and the server lives on.
#include <algorithm>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <grpcpp/client_context.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/effort.h"
#include "service/support/messages.h"
#include "service/support/process_facts.h"
#include "service/support/raw_client.h"
#include "service/support/raw_messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

using ::testing::AnyOf;
using ::testing::Eq;
using ::testing::HasSubstr;

std::string First(const VoxelizeRequest& request = SmallRequest()) {
  return UploadOf(RequestOf(request)).SerializeAsString();
}

std::string Piece(const std::vector<uint8_t>& bytes) {
  return PieceOf(bytes).SerializeAsString();
}

class CorruptStreamTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer(
        {"--log-level", "error", "--workers", "1", "--upload-idle-timeout-ms", "2000", "--max-calls", "1000"});
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    channel_ = grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials());
    ASSERT_NO_FATAL_FAILURE(ExpectServed());
    ASSERT_TRUE(SendRawMessages(channel_, kUploadMethod, {First(), Piece(glb_)}).ok());
    before_ = SettledProcessFacts(server_->pid());
  }
  // Whatever was sent: the next call is served, and nothing is left of those before.
  void TearDown() override {
    if (server_ == nullptr || client_ == nullptr) return;
    ExpectServed();
    // A connection goes when the server has come to the end of its calls, which may be thousands.
    const auto give_up = JobContext::Clock::now() + kPatience;
    while (ReadProcessFacts(server_->pid()).descriptors > before_.descriptors && JobContext::Clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_LE(SettledProcessFacts(server_->pid()).descriptors, before_.descriptors);
    server_->Signal(SIGTERM);
    const absl::StatusOr<CommandResult> end = server_->Wait();
    ASSERT_TRUE(end.ok()) << end.status();
    EXPECT_EQ(end->exit_code, 0);
  }

  void ExpectServed() {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + kPatience);
    absl::Status status;
    do {  // what a connection left behind goes a little after it
      status = client_->Voxelize(glb_, MeshFormat::kGlb, SmallRequest(), job).status();
    } while (absl::IsResourceExhausted(status) && JobContext::Clock::now() < *job.deadline());
    ASSERT_TRUE(status.ok()) << status;
  }

  // Sends bytes on a connection of their own, and reads what comes back, for `patience` or until the server hangs up.
  void SendBytes(std::string_view bytes, std::chrono::milliseconds patience = kPatience) {
    auto client = RawClient::Connect(server_->address());
    ASSERT_TRUE(client.ok()) << client.status();
    (*client)->Send(bytes);  // the server may hang up before the end
    (*client)->ReadUntilHangUp(patience);
  }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::shared_ptr<grpc::Channel> channel_;
  ProcessFacts before_;
};

TEST_F(CorruptStreamTest, BytesThatAreNoHttp2) {
  std::mt19937 random(7);
  std::string noise(100'000, '\0');
  std::generate(noise.begin(), noise.end(), [&] { return char(random()); });
  SendBytes(noise);
  SendBytes("GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n");
  SendBytes(std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11) + noise.substr(0, 512));  // a TLS hello
}

TEST_F(CorruptStreamTest, FramesThatBreakTheProtocol) {
  using namespace http2;
  const std::string request = Request(1, kUploadMethod);
  for (const std::string& frames :
       {Frame(kData, 0, 0, "data on no stream"), Frame(kContinuation, kEndHeaders, 1, "no headers before it"),
        Frame(kSettings, 0, 0, "seven b"), Frame(kHeaders, kEndHeaders, 1, std::string(64, '\xff')),
        request + Frame(kHeaders, 0, 3, "no end") + Frame(kData, 0, 1, "in between"),
        Frame(kHeaders, kEndHeaders, 2, ""), std::string("\xff\xff\xff\x00\x00\x00\x00\x00\x01", 9),
        Frame(kWindowUpdate, 0, 0, "\x7f\xff\xff\xff"), Frame(0xee, 0xff, 0x7fffffff, "a type of the future")}) {
    // Some end the connection, some the stream, some are ignored as they must be.
    SendBytes(Opening() + frames, std::chrono::milliseconds(100));
  }
}

TEST_F(CorruptStreamTest, GrpcLengthsThatLie) {
  using namespace http2;
  const std::string start = Opening() + Request(1, kUploadMethod);
  for (const std::string& bytes :
       {std::string("\0\xff\xff\xff\xff", 5) + "four gigabytes",
        std::string("\0\x04\x00\x00\x01", 5) + "beyond the limit", std::string("\0\x00\x00\x10\x00", 5) + "cut off",
        std::string("\x01\x00\x00\x00\x04", 5) + "gzip", std::string("\x07\x00\x00\x00\x04", 5) + "flag",
        std::string("\0\x00", 2)}) {
    SendBytes(start + Data(1, bytes, true), std::chrono::milliseconds(200));
    SendBytes(start + Data(1, Message(First()), false) + Data(1, bytes, true), std::chrono::milliseconds(200));
  }
}

TEST_F(CorruptStreamTest, OversizedCounts) {
  const auto refused = [&](const v1::VoxelizeRequest& request) {
    const grpc::Status status =
        SendRawMessages(channel_, kUploadMethod, {UploadOf(request).SerializeAsString(), Piece(glb_)});
    EXPECT_THAT(status.error_code(), AnyOf(grpc::StatusCode::INVALID_ARGUMENT, grpc::StatusCode::RESOURCE_EXHAUSTED))
        << request.ShortDebugString() << ": " << status.error_message();
    EXPECT_FALSE(status.error_message().empty());
  };
  const v1::VoxelizeRequest plain = RequestOf(SmallRequest());
  for (const int64_t count : {int64_t{1} << 21, int64_t{1} << 32, std::numeric_limits<int64_t>::max(), int64_t{-1},
                              std::numeric_limits<int64_t>::min()}) {
    v1::VoxelizeRequest request = plain;
    request.mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(count);
    refused(request);
    request = plain;
    request.mutable_spec()->mutable_grid()->set_padding(count);
    refused(request);
    request = plain;
    request.mutable_spec()->mutable_grid()->mutable_dims()->set_y(count);
    refused(request);
  }
  v1::VoxelizeRequest request = plain;
  for (int i = 0; i < 100'000; ++i) request.mutable_spec()->add_targets();
  refused(request);
  request = plain;
  request.mutable_spec()->add_targets()->mutable_shader()->set_name(std::string(1 << 20, 'n'));
  refused(request);
  request = plain;
  v1::ShaderCall& shader = *request.mutable_spec()->mutable_vertex_shader();
  shader.set_name("transform");
  for (int i = 0; i < 10'000; ++i) shader.add_parameters()->set_name("p" + std::to_string(i));
  refused(request);

  // And the file's own: "count":81 of an accessor becomes more than there is.
  std::string text(glb_.begin(), glb_.end());
  const size_t at = text.find("\"count\":81");
  ASSERT_NE(at, std::string::npos);
  text.replace(at, 10, "\"count\":9e9");  // one byte more: the JSON chunk no longer fits its length either
  const grpc::Status status = SendRawMessages(channel_, kUploadMethod, {First(), Piece({text.begin(), text.end()})});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
}

// Calls that begin and say no more, far more than may be open, from a client that does not care how many that are.
TEST_F(CorruptStreamTest, CallsWithoutEndOnOneConnection) {
  std::string calls;
  for (uint32_t stream = 1; stream < 10'000; stream += 2) calls += http2::Request(stream, kUploadMethod);
  SendBytes(http2::Opening() + calls, std::chrono::seconds(1));
}

// A message that cannot be read is not the end of the upload.
TEST_F(CorruptStreamTest, MessagesThatAreNoProtobuf) {
  const std::string noise(50, '\xff');
  for (const std::vector<std::string>& messages : {std::vector<std::string>{noise},
                                                   {First(), noise},
                                                   {First(), Piece(glb_), noise},
                                                   {First(), Piece(glb_).substr(0, 500)},
                                                   {First().substr(0, 3), Piece(glb_)}}) {
    const grpc::Status status = SendRawMessages(channel_, kUploadMethod, messages);
    EXPECT_THAT(status.error_code(), AnyOf(grpc::StatusCode::INVALID_ARGUMENT, grpc::StatusCode::INTERNAL))
        << status.error_message();
  }
}

// Whatever the call, the client hears what is wrong, and what was sent before is not taken for all.
TEST_F(CorruptStreamTest, EveryCallSaysThatAMessageCannotBeRead) {
  const std::string noise(50, '\xff');
  const std::string service = "/voxelpipe.v1.VoxelizationService/";
  v1::UploadMeshRequest upload, file;
  upload.mutable_upload();
  file.set_piece(glb_.data(), glb_.size());
  const std::vector<std::string> begun{upload.SerializeAsString(), file.SerializeAsString(), noise};
  const std::vector<std::pair<std::string, std::vector<std::string>>> calls = {
      {"CreateMesh", {noise}},    {"DeleteMesh", {noise}},  {"EstimateVoxelization", {noise}},
      {"ExportFile", {noise}},    {"GetMesh", {noise}},     {"GetServerInfo", {noise}},
      {"ListMeshes", {noise}},    {"ListShaders", {noise}}, {"ReleaseMesh", {noise}},
      {"UploadMesh", begun},      {"Voxelize", {noise}},    {"VoxelizeBatch", {noise}},
      {"VoxelizeUpload", {noise}}};
  for (const auto& [method, messages] : calls) {
    const grpc::Status status = SendRawMessages(channel_, service + method, messages);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << method << ": " << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("message: not a ")) << method;
  }
}

// Sixteen MiB of empty fields would be a gigabyte of messages once they were read.
TEST_F(CorruptStreamTest, EmptyFieldsWithoutNumberTakeNoMemory) {
  if (IsSanitized(server_->pid())) GTEST_SKIP() << "a sanitizer's memory is not the server's";
  const auto many = [](int field) {
    std::string fields;
    for (int i = 0; i < (8 << 20); ++i) fields += {char(field << 3 | 2), '\0'};
    return fields;
  };
  const auto in_field = [](int field, const std::string& bytes) {
    std::string out(1, char(field << 3 | 2));
    for (size_t length = bytes.size(); length != 0; length >>= 7) {
      out.push_back(char((length & 0x7f) | (length >= 0x80 ? 0x80 : 0)));
    }
    return out + bytes;
  };
  const std::string targets = many(v1::VoxelizeSpec::kTargetsFieldNumber);
  const std::string request = in_field(v1::VoxelizeRequest::kSpecFieldNumber, targets);
  const std::string service = "/voxelpipe.v1.VoxelizationService/";
  // Fields of what is around the bytes of a mesh, which may be large.
  const std::string mesh =
      in_field(v1::VoxelizeRequest::kMeshFieldNumber, in_field(v1::MeshSource::kBytesFieldNumber, many(15)));
  const std::vector<std::pair<std::string, std::string>> calls = {
      {"CreateMesh", in_field(v1::CreateMeshRequest::kMeshFieldNumber, many(15))},  // unknown fields
      {"EstimateVoxelization", in_field(v1::EstimateVoxelizationRequest::kSpecFieldNumber, targets)},
      {"ExportFile", in_field(v1::ExportFileRequest::kRequestFieldNumber, request)},
      {"GetMesh", many(15)},
      {"ListMeshes", many(15)},
      {"UploadMesh", many(15)},
      {"Voxelize", request},
      {"Voxelize", mesh},
      {"VoxelizeBatch", many(v1::VoxelizeBatchRequest::kJobsFieldNumber)},
      {"VoxelizeBatch",
       in_field(v1::VoxelizeBatchRequest::kJobsFieldNumber, in_field(v1::BatchJob::kRequestFieldNumber, request))},
      {"VoxelizeUpload", in_field(v1::VoxelizeUploadRequest::kRequestFieldNumber, request)},
      {"VoxelizeUpload", in_field(v1::VoxelizeUploadRequest::kRequestFieldNumber, mesh)}};
  const uint64_t peak = ReadProcessFacts(server_->pid()).peak_bytes;
  for (const auto& [method, message] : calls) {
    const grpc::Status status = SendRawMessages(channel_, service + method, {message});
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << method << ": " << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("at most 1048576")) << method;
  }
  // The messages' own bytes, some of which are not yet returned to the system.
  EXPECT_LT(ReadProcessFacts(server_->pid()).peak_bytes, peak + (160u << 20));
}

// A message of 256 MiB in a quarter of one: gRPC unpacks before it looks at any limit, so it must not unpack.
TEST_F(CorruptStreamTest, CompressedMessagesAreRefusedUnopened) {
  if (IsSanitized(server_->pid())) GTEST_SKIP() << "a sanitizer's memory is not the server's";
  const uint64_t peak = ReadProcessFacts(server_->pid()).peak_bytes;
  auto stub = v1::VoxelizationService::NewStub(channel_);
  for (const auto algorithm : {GRPC_COMPRESS_GZIP, GRPC_COMPRESS_DEFLATE}) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    context.set_compression_algorithm(algorithm);
    v1::GetMeshRequest request;
    request.set_name(std::string(256 << 20, 'm'));
    v1::Mesh response;
    const grpc::Status status = stub->GetMesh(&context, request, &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
  }
  EXPECT_LT(ReadProcessFacts(server_->pid()).peak_bytes, peak + (64u << 20));
}

// Many that begin, send something large that is no mesh, and wait.
TEST_F(CorruptStreamTest, AnOpenUploadKeepsNothingBesideItsMesh) {
  if (IsSanitized(server_->pid())) GTEST_SKIP() << "a sanitizer's memory is not the server's";
  struct Upload {
    grpc::ClientContext context;
    v1::Mesh response;
    std::unique_ptr<grpc::ClientWriter<v1::UploadMeshRequest>> writer;
  };
  auto stub = v1::VoxelizationService::NewStub(channel_);
  v1::UploadMeshRequest begin;
  // Unknown fields: a message of half a MiB takes thirty times as much once it has been read.
  std::string unknown;
  for (int i = 0; i < (256 << 10); ++i) unknown += {char(15 << 3 | 2), '\0'};
  ASSERT_TRUE(begin.ParseFromString(unknown));
  begin.mutable_upload();
  const uint64_t before = SettledProcessFacts(server_->pid()).resident_bytes;
  std::vector<std::unique_ptr<Upload>> uploads;
  for (int i = 0; i < 32; ++i) {
    uploads.push_back(std::make_unique<Upload>());
    Upload& upload = *uploads.back();
    upload.context.set_deadline(std::chrono::system_clock::now() + kPatience);
    upload.writer = stub->UploadMesh(&upload.context, &upload.response);
    ASSERT_TRUE(upload.writer->Write(begin)) << i;
  }
  EXPECT_LT(SettledProcessFacts(server_->pid()).resident_bytes, before + (96u << 20));
  for (const auto& upload : uploads) upload->context.TryCancel();
  for (const auto& upload : uploads) upload->writer->Finish();
}

TEST_F(CorruptStreamTest, APieceThatIsNotWhatItsChecksumSays) {
  v1::VoxelizeUploadRequest piece = PieceOf(glb_);
  piece.set_crc32c(12345);
  const grpc::Status status = SendRawMessages(channel_, kUploadMethod, {First(), piece.SerializeAsString()});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DATA_LOSS) << status.error_message();
}

// Whole calls with a few bytes changed, cut, doubled or moved, anywhere from the preface to the last message.
TEST_F(CorruptStreamTest, MutatedCalls) {
  std::mt19937 random(20111);
  const std::string preface = http2::Opening();
  const std::string call = preface + http2::Request(1, kUploadMethod) + http2::Data(1, http2::Message(First()), false) +
                           http2::Data(1, http2::Message(Piece(glb_)), true);
  std::vector<std::unique_ptr<RawClient>> open;
  for (int i = 0; i < Effort(300, 20'000); ++i) {
    std::string bytes = call;
    // Half of them keep the preface, which else ends most of them at once.
    const size_t from = i % 2 == 0 ? preface.size() : 0;
    const auto place = [&] { return from + random() % (bytes.size() - from); };
    for (uint32_t k = 0; k < 1 + random() % 4; ++k) {
      const size_t at = place();
      switch (random() % 4) {
        case 0: bytes[at] = char(random()); break;
        case 1: bytes[at] = char(bytes[at] ^ (1 << random() % 8)); break;
        case 2: bytes.erase(at, 1 + random() % 64); break;
        case 3: bytes.insert(at, bytes.substr(place(), 1 + random() % 64)); break;
      }
    }
    auto client = RawClient::Connect(server_->address());
    ASSERT_TRUE(client.ok()) << client.status();
    (*client)->Send(bytes);
    open.push_back(*std::move(client));
    if (open.size() >= 16) {  // each lives for a while
      open.front()->Read(1 << 20, std::chrono::milliseconds(5));
      open.erase(open.begin());
    }
    ASSERT_TRUE(server_->IsRunning()) << "after call " << i;
  }
}

}  // namespace
}  // namespace voxelpipe::testing
