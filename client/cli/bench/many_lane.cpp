// Jobs of one VoxelizeBatch stream. A broken stream fails its jobs and is reopened.
#include <algorithm>
#include <deque>
#include <iterator>
#include <map>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include "bench/answer.h"
#include "bench/lane.h"

namespace voxelpipe::cli {
namespace {

constexpr char kMethod[] = "/voxelpipe.v1.VoxelizationService/VoxelizeBatch";
constexpr std::chrono::milliseconds kPollInterval{100};  // poll interval of the flags of the run
constexpr std::chrono::milliseconds kPauseBroken{10};
constexpr std::chrono::seconds kPatienceAtEnd{2};  // for a server that does not end the stream after this side

// Maximum number of jobs of one message.
constexpr size_t kMaxJobs = 64, kMaxBytes = 256 << 10;

// A request message made from jobs already serialized, except for the id, which follows: protobuf fields may come in
// any order.
class Requests {
 public:
  void Add(const grpc::ByteBuffer& job, uint64_t id) {
    using google::protobuf::io::CodedOutputStream;
    constexpr int kBytesField = 2;
    uint8_t tail[16] = {uint8_t(v1::BatchJob::kIdFieldNumber << 3)};
    uint8_t* const end = CodedOutputStream::WriteVarint64ToArray(id, tail + 1);
    uint8_t head[16] = {uint8_t(v1::VoxelizeBatchRequest::kJobsFieldNumber << 3 | kBytesField)};
    const uint64_t bytes = job.Length() + uint64_t(end - tail);
    slices_.emplace_back(head, size_t(CodedOutputStream::WriteVarint64ToArray(bytes, head + 1) - head));
    std::vector<grpc::Slice> slices;
    job.Dump(&slices);  // shares the bytes
    std::move(slices.begin(), slices.end(), std::back_inserter(slices_));
    slices_.emplace_back(tail, size_t(end - tail));
    ++jobs_;
    bytes_ += job.Length();
  }
  bool full() const { return jobs_ >= kMaxJobs || bytes_ >= kMaxBytes; }
  grpc::ByteBuffer Message() const { return {slices_.data(), slices_.size()}; }

 private:
  std::vector<grpc::Slice> slices_;
  size_t jobs_ = 0, bytes_ = 0;
};

class ManyLane final : public Lane {
 public:
  ManyLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) : run_(run), stub_(std::move(channel)), tally_(run) {
    Open();
    thread_ = std::thread([this] { Serve(); });
  }

  ~ManyLane() override {
    if (thread_.joinable()) End();
  }

  void Start(LoadClock::time_point due) override {
    run_.in_flight.fetch_add(1, std::memory_order_relaxed);
    const std::lock_guard lock(mutex_);
    size_t slot = jobs_.size();
    if (free_.empty()) {
      jobs_.emplace_back();
    } else {
      slot = free_.back();
      free_.pop_back();
    }
    Submit(slot, due);
    Pump();
  }

  Ended End() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = LoadClock::now();
      HalfClose();
    }
    thread_.join();
    return tally_.ended();
  }

 private:
  enum class Event : uint8_t { kOpened, kWritten, kHalfClosed, kRead, kFinished, kPaused };
  struct Job {
    LoadClock::time_point due, sent;
    Answer answer;
    bool active = false;
    uint32_t resends = 0;
  };

  void* TagOf(Event event) { return &tags_[size_t(event)]; }

  void Open() {
    stream_.reset();
    context_.emplace();
    open_ = false;
    half_closed_ = false;
    ++pending_;
    stream_ = stub_.PrepareCall(&*context_, kMethod, &queue_);
    stream_->StartCall(TagOf(Event::kOpened));
  }

  // Under the lock.
  void Submit(size_t slot, LoadClock::time_point due) {
    Job& job = jobs_[slot];
    job.due = due;
    job.sent = LoadClock::now();
    job.answer.Reset();
    job.active = true;
    unsent_.push_back(slot);
  }

  // Under the lock.
  void Pump() {
    if (!open_ || writing_ || unsent_.empty()) return;
    Requests requests;
    while (!unsent_.empty() && !requests.full()) {
      requests.Add(run_.NextVariant().front(), unsent_.front() + 1);
      unsent_.pop_front();
    }
    writing_ = true;
    ++pending_;
    grpc::WriteOptions options;
    if (!unsent_.empty()) options.set_buffer_hint();  // another one follows immediately
    stream_->Write(requests.Message(), options, TagOf(Event::kWritten));
  }

  // Under the lock.
  void HalfClose() {
    if (!ending_ || !open_ || writing_ || half_closed_) return;
    half_closed_ = true;
    ++pending_;
    stream_->WritesDone(TagOf(Event::kHalfClosed));
  }

  void Serve() {
    for (;;) {
      void* tag = nullptr;
      bool ok = false;
      const auto next = queue_.AsyncNext(&tag, &ok, NextLook());
      if (next == grpc::CompletionQueue::SHUTDOWN) return;
      if (next == grpc::CompletionQueue::GOT_EVENT) Handle(*static_cast<const Event*>(tag), ok);
      SendDelayed();
      LookAtFlags();
    }
  }

  void LookAtFlags() {
    const std::lock_guard lock(mutex_);
    const bool stuck = ending_ && LoadClock::now() - *ending_ > kPatienceAtEnd;
    if (run_.cancel.load(std::memory_order_relaxed) || stuck) context_->TryCancel();
  }

  void Handle(Event event, bool ok) {
    const std::lock_guard lock(mutex_);
    switch (event) {
      case Event::kOpened:
        if (!ok) {
          Finish();
          break;
        }
        open_ = true;
        Read();
        Pump();
        HalfClose();
        break;
      case Event::kWritten:
        writing_ = false;
        if (!ok) open_ = false;  // the next read fails and ends the call
        Pump();
        HalfClose();
        break;
      case Event::kHalfClosed: break;
      case Event::kRead:
        if (!ok) {
          open_ = false;
          Finish();
          break;
        }
        if (TakeAnswers()) {
          Read();
          Pump();
        } else {
          context_->TryCancel();
          Finish();
        }
        break;
      case Event::kFinished: finished_ = true; break;
      case Event::kPaused:
        if (ending_) {
          queue_.Shutdown();
        } else {
          Open();
        }
        return;
    }
    --pending_;
    if (pending_ == 0 && std::exchange(finished_, false)) AfterStream();
  }

  void Read() {
    ++pending_;
    stream_->Read(&buffer_, TagOf(Event::kRead));
  }

  void Finish() {
    ++pending_;
    stream_->Finish(&status_, TagOf(Event::kFinished));
  }

  // False if the server violates the protocol.
  bool TakeAnswers() {
    const size_t bytes = buffer_.Length();
    if (!grpc::SerializationTraits<v1::VoxelizeBatchResponse>::Deserialize(&buffer_, &message_).ok()) return false;
    bool counted = false;
    for (v1::BatchReply& reply : *message_.mutable_replies()) {
      if (reply.id() == 0 || reply.id() > jobs_.size()) return false;
      // The first of several replies in one message counts the message for all.
      if (!std::exchange(counted, true)) jobs_[reply.id() - 1].answer.CountReceived(bytes);
      if (!TakeAnswer(reply)) return false;
    }
    return true;
  }

  bool TakeAnswer(v1::BatchReply& reply) {
    const size_t slot = reply.id() - 1;
    Job& job = jobs_[slot];
    if (!job.active) return false;
    Outcome outcome;
    switch (reply.reply_case()) {
      case v1::BatchReply::kError:
        outcome.code = absl::StatusCode(reply.error().code());
        for (const auto& detail : reply.error().details()) {
          outcome.retry_info |= detail.type_url().ends_with("/google.rpc.RetryInfo");
        }
        if (outcome.retry_info && Delay(slot, reply.error())) return true;
        break;
      case v1::BatchReply::kResponse:
        if (!job.answer.Take(*reply.mutable_response()).ok()) return false;
        if (!job.answer.complete()) return true;
        break;
      case v1::BatchReply::REPLY_NOT_SET: return true;  // a message of a newer server
    }
    if (outcome.code == absl::StatusCode::kOk) job.answer.Fill(run_.expected_hash, outcome);
    Complete(slot, outcome);
    const bool told_to_wait = run_.honour_retry && outcome.retry_info;  // after the window
    if (told_to_wait || !NextAtOnce(slot)) Release(slot);
    return true;
  }

  // Retries the job after the server's delay, if retries are honoured. Under the lock.
  bool Delay(size_t slot, const google::rpc::Status& error) {
    const grpc::Status status(grpc::StatusCode(error.code()), error.message(), error.SerializeAsString());
    const auto at = ResendAt(run_, FromGrpcStatus(status));
    if (!at) return false;
    jobs_[slot].active = false;
    ++jobs_[slot].resends;
    delayed_.emplace(*at, slot);
    return true;
  }

  void SendDelayed() {
    const std::lock_guard lock(mutex_);
    const LoadClock::time_point now = LoadClock::now();
    const bool cancelled = run_.cancel.load(std::memory_order_relaxed);
    while (!delayed_.empty() && (cancelled || delayed_.begin()->first <= now)) {
      const size_t slot = delayed_.begin()->second;
      delayed_.erase(delayed_.begin());
      if (cancelled) {
        Release(slot);
        continue;
      }
      jobs_[slot].answer.Reset();
      jobs_[slot].active = true;
      unsent_.push_back(slot);
    }
    Pump();
  }

  std::chrono::system_clock::time_point NextLook() {
    const std::lock_guard lock(mutex_);
    LoadClock::duration wait = kPollInterval;
    if (!delayed_.empty()) wait = std::clamp(delayed_.begin()->first - LoadClock::now(), LoadClock::duration(), wait);
    return std::chrono::system_clock::now() + std::chrono::duration_cast<std::chrono::microseconds>(wait);
  }

  void Complete(size_t slot, Outcome& outcome) {
    outcome.resends = std::exchange(jobs_[slot].resends, 0);
    tally_.Add(jobs_[slot].due, jobs_[slot].sent, outcome);
    jobs_[slot].active = false;
  }

  bool MayGoOn(LoadClock::time_point now) const {
    return run_.closed_loop && !run_.stop.load(std::memory_order_relaxed) && now < run_.end;
  }

  bool NextAtOnce(size_t slot) {
    const LoadClock::time_point now = LoadClock::now();
    if (!MayGoOn(now)) return false;
    Submit(slot, now);
    return true;
  }

  void Release(size_t slot) {
    free_.push_back(slot);
    run_.in_flight.fetch_sub(1, std::memory_order_release);
  }

  // The call ended. Its outstanding jobs fail with its status.
  void AfterStream() {
    if (ending_) {
      queue_.Shutdown();
      return;
    }
    Outcome outcome;
    outcome.code = status_.ok() ? absl::StatusCode::kDataLoss : absl::StatusCode(int(status_.error_code()));
    unsent_.clear();
    for (size_t slot = 0; slot < jobs_.size(); ++slot) {
      if (!jobs_[slot].active) continue;
      Outcome each = outcome;
      Complete(slot, each);
      if (!NextAtOnce(slot)) Release(slot);  // waits in `unsent_` for the new stream
    }
    alarm_.Set(&queue_, std::chrono::system_clock::now() + kPauseBroken, TagOf(Event::kPaused));
  }

  Event tags_[6] = {Event::kOpened, Event::kWritten,  Event::kHalfClosed,
                    Event::kRead,   Event::kFinished, Event::kPaused};
  LoadRun& run_;
  grpc::GenericStub stub_;
  grpc::CompletionQueue queue_;
  grpc::Alarm alarm_;
  std::mutex mutex_;  // guards the members below
  std::optional<grpc::ClientContext> context_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  grpc::ByteBuffer buffer_;
  v1::VoxelizeBatchResponse message_;  // reused, so that its memory is allocated once
  grpc::Status status_;
  std::deque<Job> jobs_;  // by id - 1
  std::vector<size_t> free_;
  std::deque<size_t> unsent_;
  std::multimap<LoadClock::time_point, size_t> delayed_;  // slots of refused jobs, by the time of resending
  bool open_ = false, writing_ = false, half_closed_ = false, finished_ = false;
  int pending_ = 0;  // outstanding events of this stream
  std::optional<LoadClock::time_point> ending_;
  LaneTally tally_;
  std::thread thread_;
};

}  // namespace

std::unique_ptr<Lane> MakeManyLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) {
  return std::make_unique<ManyLane>(std::move(channel), run);
}

}  // namespace voxelpipe::cli
