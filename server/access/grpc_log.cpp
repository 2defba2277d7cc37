#include "access/grpc_log.h"

#include <grpc/support/log.h>

#include <mutex>
#include <string_view>

#include "observe/log.h"

namespace voxelpipe {
namespace {

std::mutex sink_mutex;
Metrics* sink = nullptr;

void OnLine(gpr_log_func_args* args) {
  const std::string_view text = args->message;
  const bool handshake = text.find("andshake failed") != std::string_view::npos;
  {
    const std::lock_guard lock(sink_mutex);
    if (sink == nullptr) return;
    if (handshake) sink->Refused(Refusal::kTlsHandshake).Increment();
  }
  if (handshake) {
    LogLine("tls_handshake_failed").Add("error", text).Write(LogLevel::kWarn);
  } else {
    LogLine("grpc").Add("error", text).Write(LogLevel::kDebug);
  }
}

}  // namespace

void TakeGrpcLog(Metrics& metrics) {
  {
    const std::lock_guard lock(sink_mutex);
    sink = &metrics;
  }
  gpr_set_log_function(&OnLine);
  gpr_set_log_verbosity(GPR_LOG_SEVERITY_ERROR);
}

void StopTakingGrpcLog() {
  const std::lock_guard lock(sink_mutex);
  sink = nullptr;
}

}  // namespace voxelpipe
