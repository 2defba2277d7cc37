// The devices that may run a task: all rules of backend and fallback.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "job/request.h"
#include "schedule/task.h"

namespace voxelpipe {

// A worker that asks for tasks.
struct WorkerTraits {
  std::string device;                        // "cpu", "cuda:0"
  BackendChoice kind = BackendChoice::kCpu;  // its kind for TaskTraits::backend
  uint64_t batch_device_bytes = 0;           // limit of a batch in the device's own memory; 0 = none
};

// A serving device.
struct ServingDevice {
  WorkerTraits traits;
  size_t workers = 1;
};

// True if a worker may run the task while these devices serve. Not on a device that failed it before. If the task names
// a kind of backend, on that kind; on another only with fallback, if no serving device of the named kind is left that
// has not failed it.
bool MayHave(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving);

// True if the worker of the task is of another kind than intended: the kind that the task names or, if it names none,
// that of a device that failed it.
bool IsFallback(const TaskTraits& task, const WorkerTraits& worker);

// True if any of the devices may run it.
bool AnyMayHave(const TaskTraits& task, std::span<const ServingDevice> serving);

// The predicted state of the workers of one kind, for a task that any kind may run. Milliseconds are predicted and
// corrected by measurements of that kind of device for jobs of this size.
struct KindOutlook {
  size_t workers = 0;     // of serving devices
  size_t idle = 0;        // of these
  double free_in_ms = 0;  // until the first of them is idle; 0 if one is
  double task_ms = 0;     // the task itself
  double waiting_ms = 0;  // all waiting work of this kind, including the task
};

// The time at which the GPUs would have done all their waiting work.
double GpusDoneInMs(const KindOutlook& gpu);

// True if an idle worker should leave the task to the other kind, because it ends earlier there. A CPU worker leaves a
// task that it would not end before the GPUs have done all waiting work; a GPU leaves to idle CPU workers tasks that
// these end sooner, if there is one for each of the `waiting` tasks. If all are idle, one of them takes it.
bool LeavesToOtherKind(BackendChoice kind, const KindOutlook& cpu, const KindOutlook& gpu, size_t waiting);

}  // namespace voxelpipe
