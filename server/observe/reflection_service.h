// grpc.reflection.v1 as a service of our own: gRPC 1.51's plugin serves only v1alpha, which newer clients try only
// after an error.
#pragma once

#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "grpc/reflection/v1/reflection.grpc.pb.h"

namespace voxelpipe {

// Serves the program's own descriptors: a file with all its imports. Thread-safe.
class ReflectionService final : public grpc::reflection::v1::ServerReflection::CallbackService {
 public:
  // `services`: the full names for list_services.
  explicit ReflectionService(std::vector<std::string> services) : services_(std::move(services)) {}

  // Names that are not found give an error_response in the stream, as the protocol requires: NOT_FOUND, or
  // INVALID_ARGUMENT for an empty request.
  grpc::ServerBidiReactor<grpc::reflection::v1::ServerReflectionRequest,
                          grpc::reflection::v1::ServerReflectionResponse>*
  ServerReflectionInfo(grpc::CallbackServerContext* context) override;

 private:
  const std::vector<std::string> services_;
};

}  // namespace voxelpipe
