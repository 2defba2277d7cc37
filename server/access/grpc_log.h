// gRPC's own log: the only report of clients that fail before they can make a call.
#pragma once

#include "observe/metrics.h"

namespace voxelpipe {

// Forwards gRPC's error lines to the server's log: failed TLS handshakes as warnings, counted in
// metrics.Refused(kTlsHandshake); the others, which repeat our own lines, at level debug. `metrics` must live until
// StopTakingGrpcLog or the last use of gRPC. Call once per process.
void TakeGrpcLog(Metrics& metrics);
// Drops later lines.
void StopTakingGrpcLog();

}  // namespace voxelpipe
