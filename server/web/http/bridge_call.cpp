#include "web/http/bridge_call.h"

#include <utility>

#include "web/http/client_socket.h"

namespace voxelpipe {
namespace {

// How often the client's socket is looked at while gRPC works.
constexpr std::chrono::milliseconds kLookInterval{50};

}  // namespace

BridgeCall::BridgeCall(const std::shared_ptr<grpc::Channel>& channel, const Setup& setup, grpc::ByteBuffer request)
    : client_(setup.client),
      next_look_(std::chrono::system_clock::now() + kLookInterval),
      stub_(channel),
      request_(std::move(request)) {
  for (const auto& [key, value] : setup.metadata) context_.AddMetadata(key, value);
  if (setup.timeout) {
    context_.set_deadline(std::chrono::system_clock::now() +
                          std::chrono::duration_cast<std::chrono::system_clock::duration>(*setup.timeout));
  }
  call_ = stub_.PrepareCall(&context_, setup.method, &queue_);
  call_->StartCall(Begin(kStart));
  if (!WaitFor(kStart)) return;
  call_->ReadInitialMetadata(Begin(kMetadata));
  call_->Write(request_, grpc::WriteOptions().set_last_message(), Begin(kWrite));
}

BridgeCall::~BridgeCall() {
  context_.TryCancel();
  queue_.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {}  // steps that the end of the call ends
}

void* BridgeCall::Begin(Step step) {
  states_[step] = State::kBusy;
  return &states_[step];
}

bool BridgeCall::WaitFor(Step step) {
  while (states_[step] == State::kBusy && !gone_) {
    void* tag = nullptr;
    bool ok = false;
    if (queue_.AsyncNext(&tag, &ok, next_look_) == grpc::CompletionQueue::GOT_EVENT) {
      *static_cast<State*>(tag) = ok ? State::kGood : State::kBad;
      if (tag == &states_[kWrite]) request_.Clear();  // the service has it now
    }
    const auto now = std::chrono::system_clock::now();
    if (now < next_look_) continue;
    next_look_ = now + kLookInterval;
    if (HasHungUp(client_)) {
      gone_ = true;
      context_.TryCancel();
    }
  }
  return !gone_;
}

bool BridgeCall::WaitForMetadata() {
  return WaitFor(kMetadata);
}

std::string BridgeCall::Metadata(const std::string& key) const {
  if (states_[kMetadata] != State::kGood) return "";
  const auto& all = context_.GetServerInitialMetadata();
  const auto found = all.find(key);
  return found == all.end() ? "" : std::string(found->second.data(), found->second.size());
}

bool BridgeCall::Next(grpc::ByteBuffer& message) {
  if (!WaitFor(kMetadata)) return false;
  call_->Read(&incoming_, Begin(kRead));
  if (!WaitFor(kRead) || states_[kRead] == State::kBad) return false;
  message.Swap(&incoming_);
  incoming_.Clear();
  return true;
}

grpc::Status BridgeCall::Finish() {
  if (!gone_) {
    call_->Finish(&status_, Begin(kFinish));
    if (WaitFor(kFinish)) return status_;
  }
  return {grpc::StatusCode::CANCELLED, "the client closed its connection"};
}

}  // namespace voxelpipe
