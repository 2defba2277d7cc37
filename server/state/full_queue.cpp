#include "state/full_queue.h"

#include <utility>

#include "observe/metrics.h"
#include "schedule/scheduler.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// Numbers of this age are good enough: the retry delay is never shorter.
constexpr std::chrono::milliseconds kFresh{10};
constexpr std::chrono::seconds kBetweenLines{1};

}  // namespace

std::shared_ptr<const FullQueue::Answer> FullQueue::Refusal(Clock::time_point now) {
  if (!scheduler_.IsFull()) return nullptr;
  metrics_.Turned(Admission::kJobs).Increment();
  {
    const std::lock_guard lock(mutex_);
    if (answer_ && now - made_ < kFresh) return answer_;
  }
  auto answer = std::make_shared<Answer>();
  answer->status = scheduler_.FullError();
  answer->grpc_status = ToGrpcStatus(answer->status);
  const std::lock_guard lock(mutex_);
  answer_ = std::move(answer);
  made_ = now;
  return answer_;
}

std::optional<uint64_t> FullQueue::MayLog(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (logged_ && now - *logged_ < kBetweenLines) {
    ++unlogged_;
    return std::nullopt;
  }
  logged_ = now;
  return std::exchange(unlogged_, 0);
}

}  // namespace voxelpipe
