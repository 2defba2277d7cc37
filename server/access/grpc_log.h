// gRPC's own log: the only sign of a client that fails before it can make a call.
#pragma once

#include "observe/metrics.h"

namespace voxelpipe {

// From here on gRPC's own error lines come to the server's log: failed TLS handshakes as warnings, counted in
// metrics.Refused(kTlsHandshake); the rest, which repeats what our own lines say, at level debug. `metrics` must
// outlive the process's use of gRPC, or until StopTakingGrpcLog. Once for a process.
void TakeGrpcLog(Metrics& metrics);
// Lines that come later are dropped.
void StopTakingGrpcLog();

}  // namespace voxelpipe
