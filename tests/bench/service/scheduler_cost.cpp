// What the queue costs: processor time of Submit, TryTakeBatch and Ended together, a task, with so many tasks waiting
// meanwhile. One thread, so that no time is another's; argv[1]: rounds (default 5), the least of which is printed.
#include <ctime>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "observe/metrics.h"
#include "schedule/scheduler.h"

namespace voxelpipe::bench {
namespace {

class Nothing final : public Task {
 public:
  bool loaded() const override { return true; }
  bool Load() override { return true; }
  void Refuse(absl::Status) override {}
};

double CpuUs() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e6 + double(t.tv_nsec) * 1e-3;
}

std::shared_ptr<Task> MakeTask(size_t i, bool timed) {
  auto task = std::make_shared<Nothing>();
  task->traits.client = "client " + std::to_string(i % 16);
  task->traits.priority = Priority(i % kPriorities);
  task->traits.cost.run_ms = 0.05;
  if (timed) task->traits.queue_timeout = std::chrono::hours(1);
  return task;
}

double CostUs(size_t waiting, size_t batch_jobs, bool timed, Metrics& metrics) {
  constexpr size_t kTasks = 20'000;
  SchedulerOptions options;
  options.max_queue = 1 << 20;
  options.max_batch_jobs = batch_jobs;
  options.metrics = &metrics;
  Scheduler scheduler(options, 2);
  const WorkerTraits worker{"cpu", BackendChoice::kCpu};
  scheduler.SetDevice(worker, 2);
  for (size_t i = 0; i < waiting; ++i) scheduler.Submit(MakeTask(i, timed)).IgnoreError();
  std::vector<std::shared_ptr<Task>> tasks;
  for (size_t i = 0; i < kTasks; ++i) tasks.push_back(MakeTask(i, timed));
  const double began = CpuUs();
  size_t done = 0;
  for (size_t i = 0; i < kTasks; ++i) {
    scheduler.Submit(std::move(tasks[i])).IgnoreError();
    if ((i + 1) % batch_jobs != 0) continue;
    const auto batch = scheduler.TryTakeBatch(worker);
    scheduler.Ended(batch);
    done += batch.size();
  }
  const double us = (CpuUs() - began) / double(std::max<size_t>(1, done));
  for (auto rest = scheduler.TryTakeBatch(worker); !rest.empty(); rest = scheduler.TryTakeBatch(worker)) {
    scheduler.Ended(rest);
  }
  return us;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::atoi(argv[1]) : 5;
  voxelpipe::Metrics metrics;
  std::printf("waiting  batch  timed  us/task\n");
  for (const size_t waiting : {0, 10'000}) {
    for (const size_t batch : {1, 16, 64}) {
      for (const bool timed : {false, true}) {
        double least = 1e9;
        for (int i = 0; i < rounds; ++i) {
          least = std::min(least, voxelpipe::bench::CostUs(waiting, batch, timed, metrics));
        }
        std::printf("%7zu  %5zu  %5d  %7.2f\n", waiting, batch, int(timed), least);
      }
    }
  }
  return 0;
}
