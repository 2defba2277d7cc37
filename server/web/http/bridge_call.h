// A call of this server's own service, over its in-process channel, on behalf of an HTTP client.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include "web/http/frames.h"

namespace voxelpipe {

inline constexpr char kServicePath[] = "/voxelpipe.v1.VoxelizationService/";  // followed by a method

// A unary or server-streaming call of raw messages. It is an ordinary call of the service: rights, quotas, limits and
// deadlines apply there. Used by one thread, which blocks. At most one message is held; the service waits with the next
// one. The destructor ends the call.
//
// The status is asked for after the last message only, which gRPC's callback API does not allow: gRPC 1.51's in-process
// transport drops a message that no read waits for if the status is asked for and follows it.
class BridgeCall {
 public:
  struct Setup {
    std::string method;  // "/voxelpipe.v1.VoxelizationService/GetServerInfo"
    WebMetadata metadata;
    std::optional<std::chrono::nanoseconds> timeout;
    int client = -1;  // the socket: if it closes, the call is cancelled
  };

  // Starts the call.
  BridgeCall(const std::shared_ptr<grpc::Channel>& channel, const Setup& setup, grpc::ByteBuffer request);
  ~BridgeCall();
  BridgeCall(const BridgeCall&) = delete;
  BridgeCall& operator=(const BridgeCall&) = delete;

  // Waits for the metadata that begin the response, or the end of the call. False if the call was cancelled here: its
  // client is gone, or it may not go on.
  bool WaitForMetadata();
  // The metadata `key` of those; empty if it is absent. After WaitForMetadata.
  std::string Metadata(const std::string& key) const;
  // Waits for the next message. False after the last one, or if the call was cancelled here.
  bool Next(grpc::ByteBuffer& message);
  // Waits for the end of the call, after Next returned false. CANCELLED if the call was cancelled here.
  grpc::Status Finish();
  // True if the client closed its connection while this waited, or the call was not to go on.
  bool is_gone() const { return gone_; }

 private:
  // What gRPC does for the call.
  enum Step : uint8_t { kStart, kWrite, kMetadata, kRead, kFinish, kSteps };
  enum class State : uint8_t { kIdle, kBusy, kGood, kBad };

  // The tag of a step that begins now.
  void* Begin(Step step);
  // Waits until gRPC has done the step. False if the call was cancelled here.
  bool WaitFor(Step step);

  const int client_;
  std::chrono::system_clock::time_point next_look_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  grpc::GenericStub stub_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
  grpc::ByteBuffer request_, incoming_;
  grpc::Status status_;
  std::array<State, kSteps> states_{};
  bool gone_ = false;
};

}  // namespace voxelpipe
