// VoxelizeWhole calls over one connection, made of bytes that stand ready.
#include <deque>
#include <optional>
#include <thread>

#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include "bench/answer.h"
#include "bench/lane.h"

namespace voxelpipe::cli {
namespace {

constexpr char kMethod[] = "/voxelpipe.v1.VoxelizationService/VoxelizeWhole";
constexpr std::chrono::milliseconds kLookEvery{100};  // at the flags of the run
// A closed loop whose server is gone would spin: a refused call comes back at once.
constexpr std::chrono::milliseconds kPauseUnavailable{10};

class UnaryLane final : public Lane {
 public:
  UnaryLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run)
      : run_(run), stub_(std::move(channel)), tally_(run), thread_([this] { Serve(); }) {}

  ~UnaryLane() override {
    if (thread_.joinable()) End();
  }

  void Start(LoadClock::time_point due) override {
    Call* call = nullptr;
    {
      const std::lock_guard lock(mutex_);
      if (free_.empty()) {
        call = &calls_.emplace_back();
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
  // Its address is the tag of both its events, of which one at a time is to come: the answer, or the end of a pause.
  struct Call {
    LoadClock::time_point due, sent;
    std::optional<grpc::ClientContext> context;
    std::unique_ptr<grpc::GenericClientAsyncResponseReader> reader;
    grpc::ByteBuffer buffer;
    grpc::Status status;
    grpc::Alarm alarm;
    bool active = false, paused = false;
  };

  void Launch(Call& call, LoadClock::time_point due) {
    call.due = due;
    call.sent = LoadClock::now();
    call.reader.reset();
    call.context.emplace();
    if (run_.deadline) call.context->set_deadline(std::chrono::system_clock::now() + *run_.deadline);
    call.active = true;
    call.reader = stub_.PrepareUnaryCall(&*call.context, kMethod, run_.NextVariant().front(), &queue_);
    call.reader->StartCall();
    call.reader->Finish(&call.buffer, &call.status, &call);
  }

  void Serve() {
    for (;;) {
      void* tag = nullptr;
      bool ok = false;
      const auto next = queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kLookEvery);
      if (next == grpc::CompletionQueue::SHUTDOWN) return;
      if (next == grpc::CompletionQueue::GOT_EVENT) {
        Call& call = *static_cast<Call*>(tag);
        if (std::exchange(call.paused, false)) {
          Again(call);
        } else {
          Complete(call);
        }
      }
      if (run_.cancel.load(std::memory_order_relaxed)) CancelAll();
    }
  }

  absl::Status TakeAnswer(Call& call, Answer& answer) {
    if (!grpc::SerializationTraits<v1::VoxelizeWholeResponse>::Deserialize(&call.buffer, &message_).ok()) {
      return absl::DataLossError("the server's message cannot be read");
    }
    return answer.Take(*message_.mutable_result());
  }

  void Complete(Call& call) {
    Outcome outcome;
    outcome.code = absl::StatusCode(int(call.status.error_code()));
    if (call.status.ok()) {
      Answer answer;
      const absl::Status taken = TakeAnswer(call, answer);
      outcome.code = taken.code();
      if (taken.ok()) answer.Fill(run_.expected_hash, outcome);
    } else {
      outcome.retry_info = SaysWhenToRetry(call.status);
    }
    tally_.Add(call.due, call.sent, outcome);
    call.active = false;
    if (!run_.closed_loop) {
      Release(call);
    } else if (outcome.code == absl::StatusCode::kUnavailable) {
      call.paused = true;
      call.alarm.Set(&queue_, std::chrono::system_clock::now() + kPauseUnavailable, &call);
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
  v1::VoxelizeWholeResponse message_;  // used again and again: its memory is there then
  LaneTally tally_;
  bool cancelled_ = false;
  std::thread thread_;  // last: uses all of the above
};

}  // namespace

std::unique_ptr<Lane> MakeUnaryLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) {
  return std::make_unique<UnaryLane>(std::move(channel), run);
}

}  // namespace voxelpipe::cli
