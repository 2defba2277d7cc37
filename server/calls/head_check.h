// Calls whose head arrives before their message: refused before the message is read.
#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "state/service_state.h"

namespace voxelpipe {

// The end of a call that may not send its message.
struct RefusedHead {
  absl::Status status;
  std::string request_id;
};

// What the service would answer now to any message of this call: the caller has no token or no right to make the call,
// has used up its quota, or the server takes no more calls. None if the message may come: the call then takes its share
// of the quotas, and may still be refused. A refusal is counted and logged like that of a call.
std::optional<RefusedHead> CheckHead(ServiceState& state, const CallHead& head, Rpc rpc);

}  // namespace voxelpipe
