#include "web/method_stream.h"

#include <algorithm>
#include <new>
#include <utility>
#include <vector>

#include <google/protobuf/descriptor.h>
#include <grpcpp/support/slice.h>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "web/http/client_timeout.h"
#include "web/http/web_reply.h"
#include "web/http/web_request.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxNameBytes = 100;
constexpr size_t kBlockBytes = 64 << 10;  // of the response at a time

const google::protobuf::ServiceDescriptor& Service() {
  static const google::protobuf::ServiceDescriptor& service =
      *v1::VoxelizeUploadRequest::descriptor()->file()->FindServiceByName("VoxelizationService");
  return service;
}

// Of one response; used by the thread of its connection.
class MethodStream {
 public:
  MethodStream(MHD_Connection* connection, unsigned stall_seconds, std::unique_ptr<BridgeCall> call)
      : connection_(connection), stall_seconds_(stall_seconds), call_(std::move(call)) {}

  // The library's callbacks.
  static ssize_t Read(void* self, uint64_t /*position*/, char* to, size_t bytes) {
    try {
      return static_cast<MethodStream*>(self)->Read(to, bytes);
    } catch (const std::bad_alloc&) {
      return MHD_CONTENT_READER_END_WITH_ERROR;  // closes the connection
    }
  }
  static void Free(void* self) { delete static_cast<MethodStream*>(self); }

 private:
  ssize_t Read(char* to, size_t bytes) {
    if (at_ == frame_.size() && !MakeFrame()) {
      return gone_ ? MHD_CONTENT_READER_END_WITH_ERROR : MHD_CONTENT_READER_END_OF_STREAM;
    }
    size_t done = 0;
    while (done < bytes && at_ < frame_.size()) {
      const grpc::Slice& part = frame_[at_];
      const size_t take = std::min(bytes - done, part.size() - offset_);
      std::copy_n(part.begin() + offset_, take, reinterpret_cast<uint8_t*>(to) + done);
      done += take;
      offset_ += take;
      if (offset_ < part.size()) continue;
      frame_[at_++] = grpc::Slice();  // frees its memory
      offset_ = 0;
    }
    return ssize_t(done);
  }

  // False at the end.
  bool MakeFrame() {
    frame_.clear();
    at_ = offset_ = 0;
    if (ended_) return false;
    const ClientTimeoutPause pause(connection_, stall_seconds_);
    grpc::ByteBuffer message;
    if (call_->Next(message)) {
      std::vector<grpc::Slice> parts;
      if (!message.Dump(&parts).ok()) return false;
      const FrameHead head = HeadOfMessage(message.Length());
      frame_.emplace_back(head.data(), head.size());
      for (grpc::Slice& part : parts) {
        if (part.size() > 0) frame_.push_back(std::move(part));
      }
      return true;
    }
    ended_ = true;
    const grpc::Status status = call_->Finish();
    gone_ = call_->is_gone();
    if (!gone_) frame_.emplace_back(TrailerFrame(status));
    return !gone_;
  }

  MHD_Connection* const connection_;
  const unsigned stall_seconds_;
  const std::unique_ptr<BridgeCall> call_;
  std::vector<grpc::Slice> frame_;  // the parts of the frame being sent
  size_t at_ = 0, offset_ = 0;      // of the next byte: its part, and its place there
  bool ended_ = false, gone_ = false;
};

}  // namespace

absl::StatusOr<Rpc> WebMethodOf(std::string_view path) {
  const std::string name(path.substr(std::min(sizeof(kServicePath) - 1, path.size())));
  const google::protobuf::MethodDescriptor* const method = Service().FindMethodByName(name);
  if (!path.starts_with(kServicePath) || method == nullptr) {
    return absl::UnimplementedError(absl::StrCat("there is no method ", CleanText(path, kMaxNameBytes)));
  }
  for (size_t i = 0; i < kRpcs && !method->client_streaming(); ++i) {
    if (name == RpcName(Rpc(i))) return Rpc(i);
  }
  return absl::UnimplementedError(absl::StrCat(
      name,
      " takes a stream of messages, which browsers cannot send; Voxelize and CreateMesh take a mesh in one message"));
}

MHD_Result AnswerMethod(WebContext& web, MHD_Connection* connection, const BridgeCall::Setup& setup, RequestBody& body,
                        const std::string& allowed) {
  absl::Status status = body.status();
  if (status.ok()) status = CheckRequestFrame(body.head(), body.bytes());
  if (!status.ok()) return SendWebReply(connection, GrpcWebError(ToGrpcStatus(status)), allowed);

  const unsigned stall_seconds = SecondsOf(web.state.options.stall_timeout_ms);
  auto call = std::make_unique<BridgeCall>(web.channel, setup, body.Take());
  {
    const ClientTimeoutPause pause(connection, stall_seconds);
    if (!call->WaitForMetadata()) return MHD_NO;
  }
  WebReply head{MHD_HTTP_OK, kGrpcWebType, "", {}};
  if (std::string id = call->Metadata("x-request-id"); !id.empty()) {
    head.headers.emplace_back("x-request-id", std::move(id));
  }
  auto stream = std::make_unique<MethodStream>(connection, stall_seconds, std::move(call));
  MHD_Response* const response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, kBlockBytes, &MethodStream::Read,
                                                                   stream.get(), &MethodStream::Free);
  if (response != nullptr) static_cast<void>(stream.release());
  return QueueWebReply(connection, response, head, allowed);
}

}  // namespace voxelpipe
