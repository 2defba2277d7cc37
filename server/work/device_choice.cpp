#include "work/device_choice.h"

#include <algorithm>
#include <string_view>

namespace voxelpipe {
namespace {

bool FailedOn(const TaskTraits& task, const std::string& device) {
  const auto& failed = task.excluded_devices;
  return std::find(failed.begin(), failed.end(), device) != failed.end();
}

// Whether a device of this kind serves that has not failed the task.
bool IsLeft(const TaskTraits& task, BackendChoice kind, std::span<const ServingDevice> serving) {
  return std::any_of(serving.begin(), serving.end(), [&](const ServingDevice& device) {
    return device.traits.kind == kind && !FailedOn(task, device.traits.device);
  });
}

}  // namespace

bool MayHave(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving) {
  if (FailedOn(task, worker.device)) return false;
  if (task.backend == BackendChoice::kAuto || task.backend == worker.kind) return true;
  return task.fallback && !IsLeft(task, task.backend, serving);
}

bool IsFallback(const TaskTraits& task, const WorkerTraits& worker) {
  if (task.backend != BackendChoice::kAuto) return task.backend != worker.kind;
  const auto kind_of = [](std::string_view device) { return device.substr(0, device.find(':')); };
  return std::any_of(task.excluded_devices.begin(), task.excluded_devices.end(),
                     [&](const std::string& failed) { return kind_of(failed) != kind_of(worker.device); });
}

bool AnyMayHave(const TaskTraits& task, std::span<const ServingDevice> serving) {
  return std::any_of(serving.begin(), serving.end(),
                     [&](const ServingDevice& device) { return MayHave(task, device.traits, serving); });
}

bool LeavesToGpus(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving,
                  size_t waiting, size_t max_batch_jobs) {
  if (task.backend != BackendChoice::kAuto || worker.kind != BackendChoice::kCpu) return false;
  size_t next = 0;  // what the GPUs take with their next batches
  for (const ServingDevice& device : serving) {
    if (device.traits.kind != BackendChoice::kCuda || FailedOn(task, device.traits.device)) continue;
    next += device.workers * max_batch_jobs;
  }
  return waiting <= next;
}

}  // namespace voxelpipe
