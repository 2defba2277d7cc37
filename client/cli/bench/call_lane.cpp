// Single Voxelize calls over one connection. The messages are bytes that were made once, answers are looked at where they lie: what
// is left is gRPC's own cost of a call.
#include <deque>
#include <optional>
#include <thread>

#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>

#include "bench/answer.h"
#include "bench/lane.h"

namespace voxelpipe::cli {
namespace {

constexpr char kMethod[] = "/voxelpipe.v1.VoxelizationService/Voxelize";
constexpr std::chrono::milliseconds kLookEvery{100};  // at the flags of the run
// A closed loop whose server is gone would spin: a refused call comes back at once.
constexpr std::chrono::milliseconds kPauseUnavailable{10};

class CallLane final : public Lane {
 public:
  CallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run)
      : run_(run), stub_(std::move(channel)), tally_(run), thread_([this] { Serve(); }) {}

  ~CallLane() override {
    if (thread_.joinable()) End();
  }

  void Start(LoadClock::time_point due) override {
    Call* call = nullptr;
    {
      const std::lock_guard lock(mutex_);
      if (free_.empty()) {
        call = &calls_.emplace_back();
        call->InitTags();
      } else {
        call = free_.back();
        free_.pop_back();
      }
    }
    run_.in_flight.fetch_add(1, std::memory_order_relaxed);
    Launch(*call, due);
  }

  Ended End() override {
    queue_.Shutdown();
    thread_.join();
    return tally_.ended();
  }

 private:
  enum class Event : uint8_t { kWritten, kRead, kFinished, kPaused };
  struct Call;
  struct Tag {
    Call* call = nullptr;
    Event event = Event::kWritten;
  };
  struct Call {
    void InitTags() {
      written = {this, Event::kWritten};
      read = {this, Event::kRead};
      finished = {this, Event::kFinished};
      paused = {this, Event::kPaused};
    }
    Tag written, read, finished, paused;
    LoadClock::time_point due, sent;
    std::optional<grpc::ClientContext> context;
    std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream;
    grpc::ByteBuffer buffer;
    grpc::Status status;
    grpc::Alarm alarm;
    Answer answer;
    absl::Status broken;  // what the answer's own messages were at fault of
    const LoadRun::Variant* messages = nullptr;
    size_t next_message = 0;
    int pending = 0;  // events that are still to come
    bool active = false, over = false;
  };

  void Launch(Call& call, LoadClock::time_point due) {
    call.due = due;
    call.sent = LoadClock::now();
    call.stream.reset();
    call.context.emplace();
    if (run_.deadline) call.context->set_deadline(std::chrono::system_clock::now() + *run_.deadline);
    call.context->set_initial_metadata_corked(true);  // leaves together with the first message
    call.answer.Reset();
    call.broken = absl::OkStatus();
    call.messages = &run_.NextVariant();
    call.next_message = 0;
    call.pending = 2;
    call.over = false;
    call.active = true;
    call.stream = stub_.PrepareCall(&*call.context, kMethod, &queue_);
    call.stream->StartCall(nullptr);  // corked: gives no event
    WriteNext(call);
    call.stream->Read(&call.buffer, &call.read);
  }

  void WriteNext(Call& call) {
    const grpc::ByteBuffer& message = (*call.messages)[call.next_message++];
    if (call.next_message == call.messages->size()) {
      call.stream->WriteLast(message, grpc::WriteOptions(), &call.written);
    } else {
      call.stream->Write(message, &call.written);
    }
  }

  void Serve() {
    for (;;) {
      void* tag = nullptr;
      bool ok = false;
      const auto next = queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kLookEvery);
      if (next == grpc::CompletionQueue::SHUTDOWN) return;
      if (next == grpc::CompletionQueue::GOT_EVENT) Handle(*static_cast<Tag*>(tag), ok);
      if (run_.cancel.load(std::memory_order_relaxed)) CancelAll();
    }
  }

  void Handle(const Tag& tag, bool ok) {
    Call& call = *tag.call;
    switch (tag.event) {
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
          call.stream->Read(&call.buffer, &call.read);
          return;
        }
        call.over = true;
        call.stream->Finish(&call.status, &call.finished);
        return;
      case Event::kFinished: break;
      case Event::kPaused: Again(call); return;
    }
    if (--call.pending == 0) Complete(call);
  }

  void Complete(Call& call) {
    Outcome outcome;
    outcome.code = !call.broken.ok() ? call.broken.code() : absl::StatusCode(int(call.status.error_code()));
    if (outcome.code == absl::StatusCode::kOk) {
      call.answer.Fill(run_.expected_hash, outcome);
    } else {
      outcome.retry_info = SaysWhenToRetry(call.status);
    }
    tally_.Add(call.due, call.sent, outcome);
    call.active = false;
    if (!run_.closed_loop) {
      Release(call);
    } else if (outcome.code == absl::StatusCode::kUnavailable) {
      call.alarm.Set(&queue_, std::chrono::system_clock::now() + kPauseUnavailable, &call.paused);
    } else {
      Again(call);
    }
  }

  void Again(Call& call) {
    const LoadClock::time_point now = LoadClock::now();
    if (run_.stop.load(std::memory_order_relaxed) || now >= run_.end) {
      Release(call);
    } else {
      Launch(call, now);
    }
  }

  void Release(Call& call) {
    {
      const std::lock_guard lock(mutex_);
      free_.push_back(&call);
    }
    run_.in_flight.fetch_sub(1, std::memory_order_release);
  }

  // Only once nobody starts calls any more.
  void CancelAll() {
    if (std::exchange(cancelled_, true)) return;
    const std::lock_guard lock(mutex_);
    for (Call& call : calls_) {
      if (call.active) call.context->TryCancel();
    }
  }

  LoadRun& run_;
  grpc::GenericStub stub_;
  grpc::CompletionQueue queue_;
  std::mutex mutex_;        // of the next two
  std::deque<Call> calls_;  // stay where they are
  std::vector<Call*> free_;
  LaneTally tally_;
  bool cancelled_ = false;
  std::thread thread_;  // last: uses all of the above
};

}  // namespace

std::unique_ptr<Lane> MakeCallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) {
  return std::make_unique<CallLane>(std::move(channel), run);
}

}  // namespace voxelpipe::cli
