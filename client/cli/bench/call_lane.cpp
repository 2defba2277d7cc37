// Single Voxelize or VoxelizeUpload calls over one connection. Messages are serialized once and responses parsed in
// place, which leaves gRPC's own cost of a call.
#include "bench/answer.h"
#include "bench/single_calls.h"

namespace voxelpipe::cli {
namespace {

enum class Event : uint8_t { kWritten, kRead, kFinished, kPaused };

struct Stream;
struct Tag {
  Stream* call;
  Event event;
};
struct Stream : SingleCall {
  Tag written{this, Event::kWritten}, read{this, Event::kRead}, finished{this, Event::kFinished},
      paused{this, Event::kPaused};
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream;
  Answer answer;
  absl::Status broken;  // an error found in the messages of the response
  const LoadRun::Variant* messages = nullptr;
  size_t next_message = 0;
  int pending = 0;  // outstanding events
  bool over = false;
};

class CallLane final : public SingleCalls<Stream> {
 public:
  CallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) : SingleCalls(std::move(channel), run) { Serve(); }
  ~CallLane() override { Join(); }

 private:
  void Launch(Stream& call) override {
    call.context->set_initial_metadata_corked(true);  // sent together with the first message
    call.answer.Reset();
    call.broken = absl::OkStatus();
    call.messages = &run_.NextVariant();
    call.next_message = 0;
    call.pending = 2;
    call.over = false;
    call.stream = stub_.PrepareCall(&*call.context, run_.method, &queue_);
    call.stream->StartCall(nullptr);  // corked: no event
    WriteNext(call);
    call.stream->Read(&call.buffer, &call.read);
  }

  static void WriteNext(Stream& call) {
    const grpc::ByteBuffer& message = (*call.messages)[call.next_message++];
    if (call.next_message == call.messages->size()) {
      call.stream->WriteLast(message, grpc::WriteOptions(), &call.written);
    } else {
      call.stream->Write(message, &call.written);
    }
  }

  void* PauseTag(Stream& call) override { return &call.paused; }

  void Handle(void* tag, bool ok) override {
    Stream& call = *static_cast<Tag*>(tag)->call;
    switch (static_cast<Tag*>(tag)->event) {
      case Event::kWritten:
        if (ok && call.next_message < call.messages->size() && !call.over) {
          WriteNext(call);
          return;
        }
        break;
      case Event::kRead:
        if (ok) {
          if (call.broken.ok()) call.broken = call.answer.Take(call.buffer);
          if (!call.broken.ok()) call.context->TryCancel();
          call.buffer.Clear();
          if (!call.answer.complete()) {
            call.stream->Read(&call.buffer, &call.read);
            return;
          }
        }
        call.over = true;
        call.stream->Finish(&call.status, &call.finished);
        return;
      case Event::kFinished: break;
      case Event::kPaused: Again(call); return;
    }
    if (--call.pending > 0) return;
    Outcome outcome;
    outcome.code = !call.broken.ok() ? call.broken.code() : absl::StatusCode(int(call.status.error_code()));
    if (outcome.code == absl::StatusCode::kOk) call.answer.Fill(run_.expected_hash, outcome);
    call.stream.reset();  // owned by the call, which the next context releases
    Complete(call, outcome);
  }
};

}  // namespace

std::unique_ptr<Lane> MakeCallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) {
  return std::make_unique<CallLane>(std::move(channel), run);
}

}  // namespace voxelpipe::cli
