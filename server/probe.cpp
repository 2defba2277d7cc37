#include "probe.h"

#include <chrono>
#include <cstdio>

#include <grpcpp/grpcpp.h>

#include "grpc/health/v1/health.grpc.pb.h"

namespace voxelpipe {

int Probe(const std::string& address) {
  using grpc::health::v1::HealthCheckResponse;
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);  // the environment's proxy does not lead to this server
  const auto stub = grpc::health::v1::Health::NewStub(
      grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(3));
  HealthCheckResponse response;
  const grpc::Status status = stub->Check(&context, {}, &response);
  if (!status.ok()) {
    std::fprintf(stderr, "voxelpiped: %s: %s\n", address.c_str(), status.error_message().c_str());
    return 1;
  }
  if (response.status() != HealthCheckResponse::SERVING) {
    std::fprintf(stderr, "voxelpiped: %s: not serving\n", address.c_str());
    return 1;
  }
  return 0;
}

}  // namespace voxelpipe
