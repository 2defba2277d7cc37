// Responses of the page's port: their headers, and short ones as a whole.
#pragma once

#include <string>

#include <grpcpp/support/status.h>
#include <microhttpd.h>

#include "web/http/frames.h"

namespace voxelpipe {

// A response in memory.
struct WebReply {
  unsigned code = MHD_HTTP_OK;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
  WebMetadata headers;  // further ones; values of printable ASCII
};

// Adds the headers that all responses have: type, security headers, and those for pages of the foreign origin
// `allowed`, unless it is empty.
void AddWebHeaders(MHD_Response* response, const std::string& type, const std::string& allowed);
// The same with further headers, then queues it; frees `response`. MHD_NO if it is null.
MHD_Result QueueWebReply(MHD_Connection* connection, MHD_Response* response, const WebReply& reply,
                         const std::string& allowed);
MHD_Result SendWebReply(MHD_Connection* connection, const WebReply& reply, const std::string& allowed);

inline constexpr char kGrpcWebType[] = "application/grpc-web+proto";

// A gRPC-Web response without messages.
WebReply GrpcWebError(const grpc::Status& status);
// An error in words, with the gRPC status as headers, and the HTTP code that fits.
WebReply PlainError(const grpc::Status& status);
// The answer to a browser that asks whether a page of an allowed origin may send a request.
WebReply PreflightReply();

}  // namespace voxelpipe
