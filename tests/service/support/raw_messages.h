// Messages that need not be protobuf, sent as well-formed gRPC.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <grpcpp/channel.h>
#include <grpcpp/support/status.h>

namespace voxelpipe::testing {

// Sends these bytes, one message each, to a method ("/package.Service/Method"), half-closes and reads to the end. Out:
// the call's status, after kPatience DEADLINE_EXCEEDED.
grpc::Status SendRawMessages(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                             const std::vector<std::string>& messages);

}  // namespace voxelpipe::testing
