#include "service/support/raw_messages.h"

#include <chrono>

#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>

#include "service/support/server_process.h"

namespace voxelpipe::testing {

grpc::Status SendRawMessages(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                             const std::vector<std::string>& messages) {
  grpc::CompletionQueue queue;
  // One operation at a time. Out: true if it succeeded.
  const auto wait = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  grpc::Status status;
  {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kPatience);
    grpc::GenericStub stub(channel);
    const auto stream = stub.PrepareCall(&context, method, &queue);
    stream->StartCall(nullptr);
    bool open = wait();
    for (size_t i = 0; open && i < messages.size(); ++i) {
      grpc::Slice slice(messages[i]);
      stream->Write(grpc::ByteBuffer(&slice, 1), nullptr);
      open = wait();
    }
    stream->WritesDone(nullptr);
    wait();
    grpc::ByteBuffer answer;
    do {
      stream->Read(&answer, nullptr);
    } while (wait());
    stream->Finish(&status, nullptr);
    wait();
  }
  queue.Shutdown();
  wait();
  return status;
}

}  // namespace voxelpipe::testing
