#include "calls/call_record.h"

#include <utility>

#include "access/certificate_name.h"
#include "state/service_state.h"

namespace voxelpipe {

std::optional<std::string_view> MetadataOf(const grpc::CallbackServerContext& context, const char* name) {
  const auto found = context.client_metadata().find(name);
  if (found == context.client_metadata().end()) return std::nullopt;
  return std::string_view(found->second.data(), found->second.size());
}

namespace {

CallHead HeadOf(const ServiceState& state, const grpc::CallbackServerContext& context) {
  return {MetadataOf(context, "authorization"), MetadataOf(context, "x-request-id"), MetadataOf(context, "traceparent"),
          PeerOf(state, context), CertificateOf(state, context)};
}

std::string IdOf(const CallHead& head) {
  return head.request_id && IsRequestId(*head.request_id) ? std::string(*head.request_id) : MakeRequestId();
}

}  // namespace

std::string CertificateOf(const ServiceState& state, const grpc::ServerContextBase& context) {
  return state.options.tls_client_names ? ClientNameOf(*context.auth_context()) : std::string();
}

std::string PeerOf(const ServiceState& state, const grpc::ServerContextBase& context) {
  const auto found = context.client_metadata().find(ForwardedPeers::kKey);
  if (found != context.client_metadata().end()) {
    if (auto peer = state.peers.Read({found->second.data(), found->second.size()})) return *std::move(peer);
  }
  return context.peer();
}

CallRecord::Caller CallRecord::Admit(ServiceState& state, const CallHead& head, Rpc called) {
  std::string name;
  auto admitted = state.access->Admit(head.authorization, called, head.certificate, QuotaClock::now(), &name);
  return {std::move(name), std::move(admitted)};
}

CallRecord::CallRecord(ServiceState& state, const CallHead& head, Rpc called, Caller caller)
    : rpc(called),
      request_id(IdOf(head)),
      peer(head.peer),
      trace(head.traceparent ? ParseTraceparent(*head.traceparent) : std::nullopt),
      client(caller.name.empty() ? HostOfPeer(peer) : caller.name),
      metrics_(state.metrics),
      name_(std::move(caller.name)),
      admitted_(std::move(caller.admitted)) {
  metrics_.CallBegan(rpc);
}

CallRecord::CallRecord(ServiceState& state, const CallHead& head, Rpc called)
    : CallRecord(state, head, called, Admit(state, head, called)) {}

CallRecord::CallRecord(ServiceState& state, const CallHead& head, Rpc called, absl::Status refused, std::string name)
    : CallRecord(state, head, called, Caller{std::move(name), std::move(refused)}) {}

CallRecord::CallRecord(ServiceState& state, grpc::CallbackServerContext& context, Rpc called)
    : CallRecord(state, HeadOf(state, context), called) {
  context.AddInitialMetadata("x-request-id", request_id);
}

CallRecord::~CallRecord() {
  if (!logged_) Log(absl::UnknownError("the call ended by itself"));
}

absl::Status CallRecord::TakeBytes(uint64_t bytes) {
  bytes_in += bytes;
  return admitted_.ok() ? admitted_->TakeBytes(bytes) : admitted_.status();
}

void CallRecord::Count(const absl::Status& status) {
  logged_ = true;
  CountEnd(status);
}

double CallRecord::CountEnd(const absl::Status& status) {
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  metrics_.CallEnded(rpc, status.code(), seconds);
  metrics_.received_bytes.Increment(double(bytes_in));
  metrics_.sent_bytes.Increment(double(bytes_out));
  metrics_.result_bytes.Increment(double(raw_bytes_out != 0 ? raw_bytes_out : bytes_out));
  return seconds;
}

void CallRecord::Log(const absl::Status& status) {
  logged_ = true;
  const double seconds = CountEnd(status);
  if (!LogLine::IsWanted(LogLevel::kInfo)) return;
  LogLine line("call");
  line.Add("request", request_id).Add("method", RpcName(rpc)).Add("peer", peer);
  if (!name_.empty()) line.Add("client", name_);
  if (trace) line.Add("trace_id", trace->trace_id).Add("span_id", trace->span_id);
  const auto code = absl::StatusCodeToString(status.code());
  line.Add("code", std::string_view(code)).Add("ms", seconds * 1000).Add("in", bytes_in).Add("out", bytes_out);
  line.Add(facts);
  if (!status.ok()) line.Add("error", std::string_view(status.message().data(), status.message().size()));
  line.Write(LogLevel::kInfo);
}

}  // namespace voxelpipe
