#include "bench/service/bare_grpc.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <semaphore>
#include <thread>
#include <vector>

#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/client_unary_call.h>
#include <grpcpp/impl/codegen/client_unary_call.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/impl/codegen/server_callback_handlers.h>
#include <grpcpp/impl/service_type.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/support/sync_stream.h>

#include "bench/service/polled_unary.h"

namespace voxelpipe::bench {
namespace {

using google::protobuf::BytesValue;
using grpc::ByteBuffer;

constexpr char kRaw[] = "/bare.Grpc/Raw", kBytes[] = "/bare.Grpc/Bytes", kBidi[] = "/bare.Grpc/Bidi",
               kUpload[] = "/bare.Grpc/Upload", kWide[] = "/bare.Grpc/Wide";

// What the client asks for: "PIECE TOTAL".
struct Order {
  size_t piece = 1, total = 0;
};

Order ParseOrder(const std::string& text) {
  Order order;
  if (std::sscanf(text.c_str(), "%zu %zu", &order.piece, &order.total) != 2) order = {};
  return order;
}

std::string TextOf(const ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  std::string text;
  for (const grpc::Slice& slice : slices) text.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return text;
}

std::string FileText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

const std::vector<uint8_t>& ReadyBytes() {
  static const std::vector<uint8_t> bytes(size_t{8} << 20, 0x5a);
  return bytes;
}

// As many as a large result: more than the processor's near caches hold.
const std::vector<uint8_t>& WideBytes() {
  static const std::vector<uint8_t> bytes(size_t{128} << 20, 0x5a);
  return bytes;
}

// Sends the first piece of `bytes` again and again, or, if `wide`, piece after piece of all of them.
class RawSender final : public grpc::ServerWriteReactor<ByteBuffer> {
 public:
  RawSender(Order order, const std::vector<uint8_t>& bytes, bool wide)
      : left_(order.total), piece_(order.piece), bytes_(bytes), wide_(wide) {
    TakePiece();
    Next();
  }
  void OnWriteDone(bool ok) override { ok ? Next() : Finish(grpc::Status::CANCELLED); }
  void OnDone() override { delete this; }

 private:
  void TakePiece() {
    const grpc::Slice slice(bytes_.data() + at_, piece_, grpc::Slice::STATIC_SLICE);
    buffer_ = ByteBuffer(&slice, 1);
    at_ = at_ + 2 * piece_ <= bytes_.size() ? at_ + piece_ : 0;
  }
  void Next() {
    if (left_ < piece_) return Finish(grpc::Status::OK);
    left_ -= piece_;
    if (wide_) TakePiece();
    StartWrite(&buffer_);
  }
  size_t left_, at_ = 0;
  const size_t piece_;
  const std::vector<uint8_t>& bytes_;
  const bool wide_;
  ByteBuffer buffer_;
};

class BytesSender final : public grpc::ServerWriteReactor<BytesValue> {
 public:
  explicit BytesSender(Order order) : left_(order.total), piece_(order.piece) { Next(); }
  void OnWriteDone(bool ok) override { ok ? Next() : Finish(grpc::Status::CANCELLED); }
  void OnDone() override { delete this; }

 private:
  void Next() {
    if (left_ < piece_) return Finish(grpc::Status::OK);
    left_ -= piece_;
    message_.set_value(ReadyBytes().data(), piece_);
    StartWrite(&message_);
  }
  size_t left_;
  const size_t piece_;
  BytesValue message_;
};

class RawTaker final : public grpc::ServerReadReactor<ByteBuffer> {
 public:
  explicit RawTaker(ByteBuffer& response) {
    const grpc::Slice slice("taken");
    response = ByteBuffer(&slice, 1);
    StartRead(&buffer_);
  }
  void OnReadDone(bool ok) override {
    buffer_.Clear();
    if (ok) {
      StartRead(&buffer_);
    } else {
      Finish(grpc::Status::OK);
    }
  }
  void OnDone() override { delete this; }

 private:
  ByteBuffer buffer_;
};

// Answers each message with as many bytes as it asks for.
class Echo final : public grpc::ServerBidiReactor<BytesValue, BytesValue> {
 public:
  Echo() { StartRead(&request_); }
  void OnReadDone(bool ok) override {
    if (!ok) return Finish(grpc::Status::OK);
    response_.set_value(ReadyBytes().data(), ParseOrder(request_.value()).piece);
    StartWrite(&response_);
  }
  void OnWriteDone(bool ok) override {
    if (ok) StartRead(&request_);
  }
  void OnDone() override { delete this; }

 private:
  BytesValue request_, response_;
};

class Service final : public grpc::Service {
 public:
  Service() {
    using Method = grpc::internal::RpcServiceMethod;
    using grpc::internal::RpcMethod;
    AddMethod(new Method(kRaw, RpcMethod::SERVER_STREAMING, nullptr));
    AddMethod(new Method(kBytes, RpcMethod::SERVER_STREAMING, nullptr));
    AddMethod(new Method(kUnaryMethod, RpcMethod::NORMAL_RPC, nullptr));
    AddMethod(new Method(kBidi, RpcMethod::BIDI_STREAMING, nullptr));
    AddMethod(new Method(kUpload, RpcMethod::CLIENT_STREAMING, nullptr));
    AddMethod(new Method(kWide, RpcMethod::SERVER_STREAMING, nullptr));
    MarkMethodRawCallback(0, new grpc::internal::CallbackServerStreamingHandler<ByteBuffer, ByteBuffer>(
                                 [](grpc::CallbackServerContext*, const ByteBuffer* request) {
                                   return new RawSender(ParseOrder(TextOf(*request)), ReadyBytes(), false);
                                 }));
    MarkMethodCallback(1, new grpc::internal::CallbackServerStreamingHandler<BytesValue, BytesValue>(
                              [](grpc::CallbackServerContext*, const BytesValue* request) {
                                return new BytesSender(ParseOrder(request->value()));
                              }));
    MarkMethodCallback(2,
                       new grpc::internal::CallbackUnaryHandler<BytesValue, BytesValue>(
                           [](grpc::CallbackServerContext* context, const BytesValue* request, BytesValue* response) {
                             response->set_value(ReadyBytes().data(), ParseOrder(request->value()).piece);
                             grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
                             reactor->Finish(grpc::Status::OK);
                             return reactor;
                           }));
    MarkMethodCallback(3, new grpc::internal::CallbackBidiHandler<BytesValue, BytesValue>(
                              [](grpc::CallbackServerContext*) { return new Echo; }));
    MarkMethodRawCallback(
        4, new grpc::internal::CallbackClientStreamingHandler<ByteBuffer, ByteBuffer>(
               [](grpc::CallbackServerContext*, ByteBuffer* response) { return new RawTaker(*response); }));
    MarkMethodRawCallback(5, new grpc::internal::CallbackServerStreamingHandler<ByteBuffer, ByteBuffer>(
                                 [](grpc::CallbackServerContext*, const ByteBuffer* request) {
                                   return new RawSender(ParseOrder(TextOf(*request)), WideBytes(), true);
                                 }));
  }
};

// `size` bytes that begin with the order.
std::string OrderText(size_t piece, size_t total, size_t size = 0) {
  std::string text = std::to_string(piece) + " " + std::to_string(total) + " ";
  text.resize(std::max(text.size(), size), ' ');
  return text;
}

BytesValue Message(const std::string& text) {
  BytesValue message;
  message.set_value(text);
  return message;
}

}  // namespace

grpc::ByteBuffer UnaryRequest(size_t request, size_t response) {
  const grpc::Slice slice(Message(OrderText(response, 0, request)).SerializeAsString());
  return {&slice, 1};
}

int ServeBareGrpc(const BareTls& tls) {
  Service service;
  grpc::ServerBuilder builder;
  int port = 0;
  std::shared_ptr<grpc::ServerCredentials> credentials = grpc::InsecureServerCredentials();
  if (!tls.cert_file.empty()) {
    grpc::SslServerCredentialsOptions options;
    options.pem_key_cert_pairs.push_back({FileText(tls.key_file), FileText(tls.cert_file)});
    credentials = grpc::SslServerCredentials(options);
  }
  builder.AddListeningPort("127.0.0.1:0", credentials, &port);
  builder.RegisterService(&service);
  builder.SetMaxReceiveMessageSize(-1);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (!server) return 1;
  std::printf("%d\n", port);
  std::fflush(stdout);
  server->Wait();
  return 0;
}

BareGrpc::BareGrpc(pid_t server, int port, const BareTls& tls)
    : server_(server), channel_([port, &tls] {
        grpc::ChannelArguments arguments;
        arguments.SetMaxReceiveMessageSize(-1);
        arguments.SetInt(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, 16777215);
        arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
        std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
        if (!tls.cert_file.empty()) credentials = grpc::SslCredentials({FileText(tls.cert_file), "", ""});
        return grpc::CreateCustomChannel("127.0.0.1:" + std::to_string(port), credentials, arguments);
      }()) {
  channel_->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(10));
}

namespace {

template <typename Message>
double ReadAll(grpc::Channel& channel, const char* name, const std::shared_ptr<grpc::Channel>& owner,
               const Message& request) {
  const grpc::internal::RpcMethod method(name, nullptr, grpc::internal::RpcMethod::SERVER_STREAMING, owner);
  grpc::ClientContext context;
  const std::unique_ptr<grpc::ClientReader<Message>> reader(
      grpc::internal::ClientReaderFactory<Message>::Create(&channel, method, &context, request));
  Message message;
  double messages = 0;
  while (reader->Read(&message)) ++messages;
  return reader->Finish().ok() ? messages : 0;
}

}  // namespace

Measured BareGrpc::RawStream(size_t piece, size_t total, bool wide) {
  const grpc::Slice order(OrderText(piece, total));
  const ByteBuffer request(&order, 1);
  const Span span(server_);
  const double messages = ReadAll<ByteBuffer>(*channel_, wide ? kWide : kRaw, channel_, request);
  return span.End(1, messages * double(piece));
}

Measured BareGrpc::BytesStream(size_t piece, size_t total) {
  const Span span(server_);
  const double messages = ReadAll<BytesValue>(*channel_, kBytes, channel_, Message(OrderText(piece, total)));
  return span.End(1, messages * double(piece));
}

Measured BareGrpc::RawUpload(size_t piece, size_t total) {
  const grpc::internal::RpcMethod method(kUpload, nullptr, grpc::internal::RpcMethod::CLIENT_STREAMING, channel_);
  const grpc::Slice slice(ReadyBytes().data(), piece, grpc::Slice::STATIC_SLICE);
  const ByteBuffer message(&slice, 1);
  const Span span(server_);
  grpc::ClientContext context;
  ByteBuffer response;
  const std::unique_ptr<grpc::ClientWriter<ByteBuffer>> writer(
      grpc::internal::ClientWriterFactory<ByteBuffer>::Create(channel_.get(), method, &context, &response));
  double sent = 0;
  while (sent < double(total) && writer->Write(message)) sent += double(piece);
  writer->WritesDone();
  return span.End(1, writer->Finish().ok() ? sent : 0);
}

Measured BareGrpc::Unary(size_t request, size_t response, int in_flight, double seconds) {
  const grpc::internal::RpcMethod method(kUnaryMethod, nullptr, grpc::internal::RpcMethod::NORMAL_RPC, channel_);
  const BytesValue message = Message(OrderText(response, 0, request));
  std::atomic<uint64_t> done{0};
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const Span span(server_);
  std::vector<std::thread> threads;
  for (int i = 0; i < in_flight; ++i) {
    threads.emplace_back([&] {
      BytesValue answer;
      while (std::chrono::steady_clock::now() < end) {
        grpc::ClientContext context;
        if (grpc::internal::BlockingUnaryCall(channel_.get(), method, &context, message, &answer).ok()) ++done;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  return span.End(double(done), double(done) * double(request + response));
}

Measured BareGrpc::UnaryPolled(size_t request, size_t response, int in_flight, double seconds) {
  return PolledUnary(channel_, kUnaryMethod, UnaryRequest(request, response), response, in_flight, seconds, server_);
}

Measured BareGrpc::Bidirectional(size_t request, size_t response, int window, double seconds) {
  const grpc::internal::RpcMethod method(kBidi, nullptr, grpc::internal::RpcMethod::BIDI_STREAMING, channel_);
  const BytesValue message = Message(OrderText(response, 0, request));
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const Span span(server_);
  grpc::ClientContext context;
  const std::unique_ptr<grpc::ClientReaderWriter<BytesValue, BytesValue>> stream(
      grpc::internal::ClientReaderWriterFactory<BytesValue, BytesValue>::Create(channel_.get(), method, &context));
  std::counting_semaphore<1 << 20> room(window);
  std::thread writer([&] {
    while (std::chrono::steady_clock::now() < end) {
      room.acquire();
      if (!stream->Write(message)) break;
    }
    stream->WritesDone();
  });
  BytesValue answer;
  double done = 0;
  for (; stream->Read(&answer); ++done) room.release();
  writer.join();
  stream->Finish();
  return span.End(done, done * double(request + response));
}

}  // namespace voxelpipe::bench
