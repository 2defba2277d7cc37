// The head of a request as the port's answers need it.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <microhttpd.h>
#include <sys/socket.h>

#include "absl/status/statusor.h"
#include "calls/call_record.h"
#include "encode/format_registry.h"
#include "web/http/bridge_call.h"
#include "web/http/origin_rules.h"
#include "web/http/web_context.h"

namespace voxelpipe {

// A header of the request, by name in any case.
std::optional<std::string_view> HeaderOf(MHD_Connection* connection, const char* name);
RequestSource SourceOf(MHD_Connection* connection);
// True if the head announces a body.
bool HasBody(MHD_Connection* connection);
int SocketOf(MHD_Connection* connection);
// The client's address; null if it is not known.
const sockaddr* AddressOf(MHD_Connection* connection);
// The same as gRPC writes it: "ipv4:127.0.0.1:58468", "ipv6:%5B::1%5D:58468".
std::string PeerOf(MHD_Connection* connection);
// What the service learns of the caller. Views into the request's headers.
CallHead CallerOf(MHD_Connection* connection);

// The call that the request asks for: its metadata (authorization, traceparent, x-request-id, and the client's
// address) and its time-out. Errors: INVALID_ARGUMENT naming a header that gRPC cannot carry.
absl::StatusOr<BridgeCall::Setup> CallOf(const WebContext& web, MHD_Connection* connection, std::string method);

// The output format that `?format=NAME` asks for. INVALID_ARGUMENT naming those that there are.
absl::StatusOr<const OutputFormat*> AskedFormat(MHD_Connection* connection);

// True if the type is `wanted`, in any case, with or without parameters.
bool IsType(std::optional<std::string_view> type, std::string_view wanted);

}  // namespace voxelpipe
