#include "call_watch.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "channel.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kPollInterval{10};
// The thread blocks only after this long without calls: waking it costs a short call more than everything else here.
constexpr int kIdleLooks = 100;

}  // namespace

// The thread that polls, and the calls that it polls. A call costs a lock and a list entry.
class CallWatcher {
 public:
  static CallWatcher& Get() {
    static CallWatcher watcher;
    return watcher;
  }
  ~CallWatcher() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_one();
    thread_.join();
  }

  void Add(CallWatch& watch) {
    bool wake;
    {
      const std::lock_guard lock(mutex_);
      watches_.push_back(&watch);
      wake = asleep_;
    }
    if (wake) changed_.notify_one();
  }
  // Afterwards the call of the watch is not accessed any more.
  void Remove(CallWatch& watch) {
    const std::lock_guard lock(mutex_);
    const auto it = std::find(watches_.begin(), watches_.end(), &watch);
    *it = watches_.back();
    watches_.pop_back();
  }

 private:
  CallWatcher() : thread_([this] { Run(); }) {}

  void Run() {
    std::unique_lock lock(mutex_);
    int idle = 0;
    while (!stopped_) {
      idle = watches_.empty() ? idle + 1 : 0;
      if (idle > kIdleLooks) {
        asleep_ = true;
        changed_.wait(lock, [this] { return stopped_ || !watches_.empty(); });
        asleep_ = false;
      }
      for (CallWatch* watch : watches_) {
        if (watch->cancelled_ || watch->job_.Check().ok()) continue;
        watch->cancelled_ = true;
        watch->context_.TryCancel();
      }
      changed_.wait_for(lock, kPollInterval, [this] { return stopped_; });
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<CallWatch*> watches_;
  bool asleep_ = false, stopped_ = false;
  std::thread thread_;  // last member: it uses all of the above
};

CallWatch::CallWatch(grpc::ClientContext& context, const JobContext& job) : context_(context), job_(job) {
  if (job.deadline()) {
    const auto left = *job.deadline() - JobContext::Clock::now();
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::duration_cast<std::chrono::system_clock::duration>(left));
  }
  CallWatcher::Get().Add(*this);
}

CallWatch::~CallWatch() {
  CallWatcher::Get().Remove(*this);
}

absl::Status CallStatus(const grpc::Status& status, const JobContext& job, const std::string& target) {
  if (status.ok()) return absl::OkStatus();
  absl::Status ours = FromGrpcStatus(status);
  if (absl::IsCancelled(ours) || absl::IsDeadlineExceeded(ours)) {
    if (absl::Status ended = job.Check(); !ended.ok()) return ended;
  }
  if (absl::IsCancelled(ours)) {  // a gRPC server that shuts down ends new calls so
    const std::string text(ours.message());
    const bool silent = text.empty() || text == "CANCELLED";
    return absl::UnavailableError(
        absl::StrCat(target, ": the server has cancelled the call", silent ? "" : ": ", silent ? "" : text));
  }
  if (absl::IsUnimplemented(ours)) return OtherContractError(target);
  if (absl::IsUnavailable(ours)) {
    absl::Status named = absl::UnavailableError(absl::StrCat(target, ": ", std::string(ours.message())));
    ours.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) { named.SetPayload(url, payload); });
    if (SaysNotConnected(std::string(ours.message()))) MarkConnectError(named);
    return named;  // with the delay that the server asks for
  }
  return ours;
}

}  // namespace voxelpipe
