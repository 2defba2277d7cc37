// What every call has from its first moment to its last: an id, a caller, a line in the access log, a place in the
// metrics.
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

// The name in the certificate of the call's client, where the operator wants certificates to name clients; else empty.
std::string CertificateOf(const ServiceState& state, const grpc::ServerContextBase& context);

// Made when a call comes, on gRPC's thread. Members that change are guarded by the call.
class CallRecord {
 public:
  // Asks the door (AccessControl) and answers with the metadata `x-request-id`: the caller's own if it sent a valid
  // one, else a new one.
  CallRecord(ServiceState& state, grpc::CallbackServerContext& context, Rpc called);
  ~CallRecord();
  CallRecord(const CallRecord&) = delete;
  CallRecord& operator=(const CallRecord&) = delete;

  // OK where the caller may make this call; else the status to end it with, already counted.
  absl::Status admission() const { return admitted_.status(); }
  Role role() const { return admitted_.ok() ? admitted_->role() : Role::kMonitor; }
  // `bytes` of a mesh came: counts them. Errors: RESOURCE_EXHAUSTED beyond the client's quota.
  absl::Status TakeBytes(uint64_t bytes);
  // A job of a stream came. Errors: the same.
  absl::Status TakeCall() { return admitted_.ok() ? admitted_->TakeCall() : admitted_.status(); }
  // Before the last word is given to gRPC: from then on the client may begin another call in place of this one.
  void Answered() {
    if (admitted_.ok()) admitted_->Answered();
  }

  // The call is over: writes its line into the access log and counts it; or counts it alone. One of the two, once.
  void Log(const absl::Status& status);
  void Count(const absl::Status& status);

  const Rpc rpc;
  const std::string request_id;
  const std::string peer;                   // the connection's other end
  const std::optional<TraceContext> trace;  // of the caller
  std::string
      client;  // whose it is: that of the token or the certificate, else the peer's address; set once, by the constructor
  const std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  uint64_t bytes_in = 0, bytes_out = 0;  // of meshes, of results as they were sent
  uint64_t raw_bytes_out = 0;            // of results before compression; 0: the same as bytes_out
  LogFields facts;                       // what else is known

 private:
  // In: what came with the call under a name.
  static std::optional<std::string_view> Metadata(const grpc::CallbackServerContext& context, const char* name);
  static std::string IdOf(const grpc::CallbackServerContext& context);
  static std::optional<TraceContext> TraceOf(const grpc::CallbackServerContext& context);

  // Out: how long the call took, in seconds.
  double CountEnd(const absl::Status& status);

  Metrics& metrics_;
  std::string name_;  // of the token or the certificate, also where the caller is refused; empty: not known
  absl::StatusOr<Admitted> admitted_;
  bool logged_ = false;
};

}  // namespace voxelpipe
