// grpc.reflection.v1 as a service of our own: gRPC 1.51's plugin answers v1alpha alone, which newer clients ask only
// after an error.
#pragma once

#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "grpc/reflection/v1/reflection.grpc.pb.h"

namespace voxelpipe {

// Answers from the descriptions that the program was built with, a file with all that it imports. Thread-safe.
class ReflectionService final : public grpc::reflection::v1::ServerReflection::CallbackService {
 public:
  // `services`: the full names that list_services gives.
  explicit ReflectionService(std::vector<std::string> services) : services_(std::move(services)) {}

  // What cannot be found is an error_response in the stream, as the protocol wants it: NOT_FOUND, or INVALID_ARGUMENT
  // for a request that asks nothing.
  grpc::ServerBidiReactor<grpc::reflection::v1::ServerReflectionRequest,
                          grpc::reflection::v1::ServerReflectionResponse>*
  ServerReflectionInfo(grpc::CallbackServerContext* context) override;

 private:
  const std::vector<std::string> services_;
};

}  // namespace voxelpipe
