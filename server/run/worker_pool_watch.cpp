// The pool's watch: forwards cancellations to runs on GPUs, and abandons threads that hang in a device.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "observe/log.h"
#include "observe/metrics.h"
#include "run/worker_pool.h"
#include "run/worker_pool_state.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

// The interval of the watch while there is work. Cancelled jobs of a GPU are stopped within this time.
constexpr milliseconds kPollInterval{10};
// Time for a GPU to react when all its jobs are cancelled or past their deadlines, ...
constexpr milliseconds kCancelPatience{5'000};
// ... and if the process ends.
constexpr milliseconds kHastyPatience{300};
// Time limit of a probe. The first use of a device creates its context, which takes long.
constexpr milliseconds kProbePatience{20'000};
// Maximum of abandoned threads of a device: beyond that it gets no new worker, and without workers no probe.
constexpr size_t kMaxLeftBehind = 8;
// Multiple of a batch's predicted time that it may take without progress, if longer than the stall limit.
constexpr int kPredictionSlack = 10;
constexpr milliseconds kNever = std::chrono::hours(24 * 365);

}  // namespace

void WorkerPool::Hasten() {
  {
    const std::lock_guard lock(watch_mutex_);
    hasty_ = true;
  }
  WakeWatch();
}

void WorkerPool::Watch() {
  std::unique_lock lock(watch_mutex_);
  while (!stopping_) {
    watch_woken_ = false;
    lock.unlock();
    const bool busy = LookAround();
    lock.lock();
    const auto woken = [this] { return stopping_ || watch_woken_; };
    if (busy) {
      watch_changed_.wait_for(lock, kPollInterval, [this] { return stopping_; });
    } else {
      watch_idle_ = true;
      watch_changed_.wait(lock, woken);
      watch_idle_ = false;
    }
  }
}

void WorkerPool::WakeWatch() {
  {
    const std::lock_guard lock(watch_mutex_);
    watch_woken_ = true;
    if (!watch_idle_) return;
  }
  watch_changed_.notify_one();
}

milliseconds WorkerPool::PatienceWith(const DeviceRun& run) const {
  const milliseconds slow = options_.stall.count() == 0 ? kNever : options_.stall + kPredictionSlack * run.predicted();
  if (!run.Unwanted()) return slow;
  const std::lock_guard lock(watch_mutex_);
  return std::min(slow, hasty_ ? kHastyPatience : kCancelPatience);
}

bool WorkerPool::LookAround() {
  const Clock::time_point now = Clock::now();
  milliseconds probe_patience;
  {
    const std::lock_guard lock(watch_mutex_);
    probe_patience = hasty_ ? kHastyPatience : kProbePatience;
  }
  bool busy = false, all_serve = true;
  for (const auto& device : devices_) {
    std::vector<std::shared_ptr<DeviceRun>> abandoned;
    bool probe_stuck = false;
    {
      const std::lock_guard lock(device->mutex);
      const auto crew = device->crew;
      for (const auto& worker : crew) {
        const bool probing = worker->probing_since.has_value();
        if (worker->run && device->watched) {
          busy = true;
          worker->run->PassOnCancels();
          const milliseconds patience = PatienceWith(*worker->run);
          if (worker->run->Silence(now) < patience || !worker->run->Abandon(now, patience)) continue;
          abandoned.push_back(worker->run);
          if (device->metrics != nullptr) device->metrics->workers_busy.Decrement();
        } else if (probing) {
          busy = true;
          if (now - *worker->probing_since < probe_patience) continue;
          probe_stuck = true;
          if (device->health.state() == DeviceState::kProbing) {
            device->health.Probed(absl::DeadlineExceededError("the probe does not end"), now);
          }
        } else {
          continue;
        }
        worker->is_left_behind = true;
        worker->thread.detach();
        ++left_behind_;
        ++device->away;
        std::erase(device->crew, worker);
        if (!device->stopping && device->away < kMaxLeftBehind) StartWorker(device);
        LogMessage(LogLevel::kError, absl::StrCat("device ", device->traits.device, ": worker ", worker->name,
                                                  " does not come back; its thread is left behind"));
      }
      all_serve &= device->health.serving();
      if (!abandoned.empty() || probe_stuck) device->changed.notify_all();
    }
    for (const auto& run : abandoned) {
      const std::string reason = "it gave no sign of life for so long that it is taken for lost";
      const absl::Status failure = MarkDeviceFailure(absl::UnavailableError(reason), DeviceFailureKind::kLost);
      scheduler_.Ended(run->TakeAnswered());
      Failed(*device, DeviceFailureKind::kLost, reason);
      for (DeviceRun::Left& left : run->TakeLeft()) FailOver(*device, std::move(left.task), failure);
      all_serve = false;
    }
    if (probe_stuck) Failed(*device, DeviceFailureKind::kLost, "the probe does not end");
  }
  if (!all_serve) RefuseStranded();
  return busy || !all_serve;
}

}  // namespace voxelpipe
