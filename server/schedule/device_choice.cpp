#include "schedule/device_choice.h"

#include <algorithm>
#include <string_view>

namespace voxelpipe {
namespace {

bool FailedOn(const TaskTraits& task, const std::string& device) {
  const auto& failed = task.excluded_devices;
  return std::find(failed.begin(), failed.end(), device) != failed.end();
}

// True if a serving device of this kind has not failed the task.
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

double GpusDoneInMs(const KindOutlook& gpu) {
  return gpu.free_in_ms + std::max(gpu.task_ms, gpu.waiting_ms / double(std::max<size_t>(1, gpu.workers)));
}

bool LeavesToOtherKind(BackendChoice kind, const KindOutlook& cpu, const KindOutlook& gpu, size_t waiting) {
  if (cpu.workers == 0 || gpu.workers == 0) return false;
  if (kind == BackendChoice::kCpu) return cpu.task_ms >= GpusDoneInMs(gpu);
  return cpu.idle > 0 && cpu.idle >= waiting && cpu.task_ms < gpu.task_ms;
}

}  // namespace voxelpipe
