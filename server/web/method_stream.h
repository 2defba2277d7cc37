// The answer of a gRPC-Web request: the messages of a call as frames.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <grpcpp/support/status.h>
#include <microhttpd.h>

#include "absl/status/statusor.h"
#include "observe/metrics.h"
#include "web/http/bridge_call.h"
#include "web/http/request_body.h"
#include "web/http/web_context.h"

namespace voxelpipe {

// The method of this path, which browsers can call. UNIMPLEMENTED if there is none of this name, or it takes a stream
// of requests, naming the methods to call in its place.
absl::StatusOr<Rpc> WebMethodOf(std::string_view path);

// Makes the call with the message of `body`, waits for the beginning of its response, and queues that. Messages are
// then read one by one as the client takes their bytes.
MHD_Result AnswerMethod(WebContext& web, MHD_Connection* connection, const BridgeCall::Setup& setup, RequestBody& body,
                        const std::string& allowed);

}  // namespace voxelpipe
