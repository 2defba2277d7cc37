#include "channel.h"

#include <grpc/impl/codegen/compression_types.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/client_interceptor.h>

#include <cstring>
#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "address.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "load/local_file.h"
#include "wire/contract_revision.h"

namespace voxelpipe {
namespace {

constexpr char kConnectUrl[] = "voxelpipe/connect_error";

bool IsLoopback(const std::string& target) {
  for (const char* host : {"localhost:", "127.", "[::1]"}) {
    if (absl::StartsWith(target, host)) return true;
  }
  return false;
}

grpc::ChannelArguments MakeArguments(const std::string& target) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  arguments.SetMaxSendMessageSize(-1);
  // No compressed messages: a message takes the memory that was received.
  arguments.SetInt(GRPC_COMPRESSION_CHANNEL_ENABLED_ALGORITHMS_BITSET, 1 << GRPC_COMPRESS_NONE);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, 16777215);  // a quarter faster on gigabytes
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL,
                   1);  // clients of one process share no connection and no back-off
  // Within its back-off a channel fails calls without an attempt to connect: CallWithRetries waits between attempts.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 250);
  // Keepalive: if the server's machine is gone, calls end after 25 s. Servers accept pings at this interval.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 10000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 15000);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  // A proxy from the environment does not apply to this machine itself.
  if (IsLoopback(target)) arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  return arguments;
}

// gRPC 1.51 reads errno of connect() only after calls that may change it (fixed later: grpc/grpc#35064), and so takes a
// connection in progress for a failed one: on a busy machine one in a thousand. Only consecutive failures count.
constexpr int kAttempts = 3;

// The state in which the first attempt of a new channel ended, or the last one before the deadline.
grpc_connectivity_state StateAfterAttempt(grpc::Channel& channel, std::chrono::system_clock::time_point deadline) {
  for (;;) {
    const grpc_connectivity_state state = channel.GetState(/*try_to_connect=*/true);
    const bool ended = state != GRPC_CHANNEL_IDLE && state != GRPC_CHANNEL_CONNECTING;
    if (ended || !channel.WaitForStateChange(state, deadline)) return state;
  }
}

// Why a channel's attempts to connect failed, in gRPC's text.
std::string LastError(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(1));
  grpc::health::v1::HealthCheckResponse response;
  const grpc::Status status =
      grpc::health::v1::Health::NewStub(channel)->Check(&context, grpc::health::v1::HealthCheckRequest(), &response);
  std::string message = status.error_message();
  constexpr std::string_view kLast = "last error: ";
  if (const size_t at = message.find(kLast); at != std::string::npos) message.erase(0, at + kLast.size());
  for (const char* code : {"UNKNOWN: ", "UNAVAILABLE: "}) {
    if (absl::StartsWith(message, code)) message.erase(0, std::strlen(code));
  }
  for (const char* scheme : {"ipv4:", "ipv6:", "unix:"}) {  // with an address: the target is already named
    const size_t end = message.find(": ");
    if (absl::StartsWith(message, scheme) && end != std::string::npos) message.erase(0, end + 2);
  }
  return message;
}

absl::Status ConnectError(const std::string& target, const std::string& why) {
  absl::Status status = absl::UnavailableError(absl::StrCat("cannot connect to ", target, ": ", why));
  MarkConnectError(status);
  return status;
}

// In: gRPC's text. Out: what it means in terms of the options.
std::string Explained(const std::string& error, bool tls) {
  if (error.empty()) return "refused, not reachable or unknown, or TLS on one side only";
  const std::string lower = absl::AsciiStrToLower(error);
  if (!tls)
    return absl::StrContains(lower, "socket closed") ? absl::StrCat(error, " (is it a server with TLS?)") : error;
  if (absl::StrContains(lower, "wrong version number")) return absl::StrCat(error, " (is it a server without TLS?)");
  for (const char* sign : {"certificate verify failed", "certificate_verify_failed", "peer name", "peer cert"}) {
    if (absl::StrContains(lower, sign)) {
      return absl::StrCat(
          "certificate verification failed; the client's TLS settings name the trusted CAs and the name in the "
          "certificate: ",
          error);
    }
  }
  return error;
}

absl::StatusOr<std::string> ReadPem(const std::string& path) {
  if (path.empty()) return std::string();
  constexpr uint64_t kMaxPemBytes = 16 << 20;
  const absl::StatusOr<FileBytes> bytes = ReadLocalFile(path, kMaxPemBytes);
  if (!bytes.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", std::string(bytes.status().message())));
  }
  std::string text(bytes->begin(), bytes->end());
  if (!absl::StrContains(text, "-----BEGIN")) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": holds nothing in PEM"));
  }
  return text;
}

// The system's CA certificates. gRPC's own list is not installed everywhere.
constexpr char kSystemCa[] = "/etc/ssl/certs/ca-certificates.crt";

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> MakeCredentials(const std::optional<ClientTls>& tls) {
  if (!tls) return grpc::InsecureChannelCredentials();
  if (tls->cert_file.empty() != tls->key_file.empty()) {
    return absl::InvalidArgumentError("a client's certificate needs its key, and the key its certificate");
  }
  grpc::SslCredentialsOptions options;
  const bool system = tls->ca_file.empty() && std::filesystem::exists(kSystemCa);
  for (const auto& [path, text] :
       {std::pair{system ? std::string(kSystemCa) : tls->ca_file, &options.pem_root_certs},
        std::pair{tls->cert_file, &options.pem_cert_chain}, std::pair{tls->key_file, &options.pem_private_key}}) {
    absl::StatusOr<std::string> pem = ReadPem(path);
    if (!pem.ok()) return pem.status();
    *text = *std::move(pem);
  }
  return grpc::SslCredentials(options);
}

// Adds the token to every call of a channel, with TLS or without: call credentials would need TLS.
class TokenSender final : public grpc::experimental::Interceptor {
 public:
  explicit TokenSender(const std::string& authorization) : authorization_(authorization) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(grpc::experimental::InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      methods->GetSendInitialMetadata()->emplace("authorization", authorization_);
    }
    methods->Proceed();
  }

 private:
  const std::string& authorization_;  // of the factory, which the channel owns
};

class TokenSenders final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit TokenSenders(const std::string& token) : authorization_("Bearer " + token) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(grpc::experimental::ClientRpcInfo*) override {
    return new TokenSender(authorization_);  // owned by gRPC
  }

 private:
  const std::string authorization_;
};

// Empty without a token.
std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> MakeSenders(
    const std::string& token) {
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> senders;
  if (!token.empty()) senders.push_back(std::make_unique<TokenSenders>(token));
  return senders;
}

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& target, const ConnectOptions& options) {
  if (absl::Status bad = CheckAddress(target); !bad.ok()) return bad;
  const auto credentials = MakeCredentials(options.tls);
  if (!credentials.ok()) return credentials.status();
  if (options.token.find_first_of(" \r\n\t") != std::string::npos) {
    return absl::InvalidArgumentError("the token has spaces or line ends in it");
  }
  grpc::ChannelArguments arguments = MakeArguments(target);
  if (options.tls && !options.tls->server_name.empty()) {
    arguments.SetSslTargetNameOverride(options.tls->server_name);
  }
  const auto deadline = std::chrono::system_clock::now() + options.timeout;
  for (int attempt = 1; attempt <= kAttempts; ++attempt) {
    // A channel waits before it retries; a new channel does not.
    std::shared_ptr<grpc::Channel> channel = grpc::experimental::CreateCustomChannelWithInterceptors(
        target, *credentials, arguments, MakeSenders(options.token));
    const grpc_connectivity_state state = StateAfterAttempt(*channel, deadline);
    if (state == GRPC_CHANNEL_READY) return channel;
    if (state == GRPC_CHANNEL_IDLE || state == GRPC_CHANNEL_CONNECTING) {
      return ConnectError(target, absl::StrCat("no answer within ", options.timeout.count(), " ms"));
    }
    if (attempt == kAttempts) return ConnectError(target, Explained(LastError(channel), options.tls.has_value()));
  }
  return absl::InternalError("no attempt to connect was made");
}

bool SaysNotConnected(std::string_view text) {
  const std::string lower = absl::AsciiStrToLower(absl::string_view(text.data(), text.size()));
  for (const char* sign :
       {"failed to connect to all addresses", "connections to all backends failing", "dns resolution failed"}) {
    if (absl::StrContains(lower, sign)) return true;
  }
  return false;
}

absl::Status OtherContractError(const std::string& target) {
  return absl::UnimplementedError(absl::StrCat("the server at ", target,
                                               " speaks another version of the contract than this client, which is "
                                               "made for revision ",
                                               kContractRevision));
}

void MarkConnectError(absl::Status& status) {
  status.SetPayload(kConnectUrl, absl::Cord());
}

bool IsConnectError(const absl::Status& status) {
  return status.GetPayload(kConnectUrl).has_value();
}

}  // namespace voxelpipe
