// The record of a call: its id, its caller, its line in the access log, its metrics.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <grpcpp/server_context.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "access/access_control.h"
#include "observe/log.h"
#include "observe/metrics.h"
#include "observe/trace.h"

namespace voxelpipe {

struct ServiceState;

// The result of gRPC's InternalInlineable for all reactors: OnCancel and OnDone never block, so they need no other
// thread.
inline constexpr bool kReactAtOnce = true;

// The name in the certificate of the call's client, if the operator lets certificates name clients; otherwise empty.
std::string CertificateOf(const ServiceState& state, const grpc::ServerContextBase& context);

// The address of the call's client, also of one whose call this process forwards (ForwardedPeers).
std::string PeerOf(const ServiceState& state, const grpc::ServerContextBase& context);

// The value of a metadata key of the call.
std::optional<std::string_view> MetadataOf(const grpc::CallbackServerContext& context, const char* name);

// What a call says of itself before its message. Views into memory of the caller.
struct CallHead {
  std::optional<std::string_view> authorization, request_id, traceparent;
  std::string peer;         // address of the client
  std::string certificate;  // CertificateOf
};

// Created when a call starts, on gRPC's thread. The call guards members that change.
class CallRecord {
 public:
  // Checks AccessControl, and sets the metadata `x-request-id` of the response: the caller's own if it is valid,
  // otherwise a new one.
  CallRecord(ServiceState& state, grpc::CallbackServerContext& context, Rpc called);
  // Of a call that ends before its message with `refused`. `name`: that of the token, if it is known.
  CallRecord(ServiceState& state, const CallHead& head, Rpc called, absl::Status refused, std::string name);
  ~CallRecord();
  CallRecord(const CallRecord&) = delete;
  CallRecord& operator=(const CallRecord&) = delete;

  // OK if the caller may make this call; otherwise the status to end it with, already counted.
  absl::Status admission() const { return admitted_.status(); }
  Role role() const { return admitted_.ok() ? admitted_->role() : Role::kMonitor; }
  // Counts `bytes` of a mesh. Errors: RESOURCE_EXHAUSTED beyond the client's quota.
  absl::Status TakeBytes(uint64_t bytes);
  // Counts a job of a stream. Errors: the same.
  absl::Status TakeCall() { return admitted_.ok() ? admitted_->TakeCall() : admitted_.status(); }
  // Call before the last write: afterwards the client may begin another call in place of this one.
  void Answered() {
    if (admitted_.ok()) admitted_->Answered();
  }

  // The call ended: writes its line to the access log and counts it; or only counts it. Call one of the two, once.
  void Log(const absl::Status& status);
  void Count(const absl::Status& status);

  const Rpc rpc;
  const std::string request_id;
  const std::string peer;                   // address of the client
  const std::optional<TraceContext> trace;  // of the caller
  // Whose call it is: the name of the token or the certificate, else the peer's address. Set once, by the constructor.
  std::string client;
  const std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  uint64_t bytes_in = 0, bytes_out = 0;  // of meshes, of results as sent
  uint64_t raw_bytes_out = 0;            // of results before compression; 0: the same as bytes_out
  LogFields facts;                       // further fields

 private:
  // Whose call it is, and whether that caller may make it.
  struct Caller {
    std::string name;
    absl::StatusOr<Admitted> admitted;
  };
  static Caller Admit(ServiceState& state, const CallHead& head, Rpc called);
  CallRecord(ServiceState& state, const CallHead& head, Rpc called);
  CallRecord(ServiceState& state, const CallHead& head, Rpc called, Caller caller);

  // Out: the duration of the call in seconds.
  double CountEnd(const absl::Status& status);

  Metrics& metrics_;
  std::string name_;  // of the token or the certificate, also for refused callers; empty: unknown
  absl::StatusOr<Admitted> admitted_;
  bool logged_ = false;
};

}  // namespace voxelpipe
