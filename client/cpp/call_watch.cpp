#include "call_watch.h"

#include <chrono>
#include <string>

#include "absl/strings/str_cat.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kLookEvery{10};

}  // namespace

CallWatch::CallWatch(grpc::ClientContext& context, const JobContext& job) : context_(context), job_(job) {
  if (job.deadline()) {
    const auto left = *job.deadline() - JobContext::Clock::now();
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::duration_cast<std::chrono::system_clock::duration>(left));
  }
  thread_ = std::thread([this] {
    std::unique_lock lock(mutex_);
    while (!done_changed_.wait_for(lock, kLookEvery, [this] { return done_; })) {
      if (job_.Check().ok()) continue;
      context_.TryCancel();
      return;
    }
  });
}

CallWatch::~CallWatch() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  done_changed_.notify_one();
  thread_.join();
}

absl::Status CallStatus(const grpc::Status& status, const JobContext& job, const std::string& target) {
  if (status.ok()) return absl::OkStatus();
  absl::Status ours = FromGrpcStatus(status);
  if (absl::IsCancelled(ours) || absl::IsDeadlineExceeded(ours)) {
    if (absl::Status ended = job.Check(); !ended.ok()) return ended;
  }
  if (absl::IsUnavailable(ours)) {
    return absl::UnavailableError(absl::StrCat(target, ": ", std::string(ours.message())));
  }
  return ours;
}

}  // namespace voxelpipe
