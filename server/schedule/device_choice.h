// Which devices may have a task. The rules of backend and fallback stand here and nowhere else.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "job/request.h"
#include "schedule/task.h"

namespace voxelpipe {

// What asks for work.
struct WorkerTraits {
  std::string device;                        // "cpu", "cuda:0"
  BackendChoice kind = BackendChoice::kCpu;  // what it counts as for TaskTraits::backend
  uint64_t batch_device_bytes = 0;           // what a batch may take of the device's own memory; 0 = no limit
};

// A device that takes tasks now.
struct ServingDevice {
  WorkerTraits traits;
  size_t workers = 1;
};

// True if a worker may have the task while these devices serve. Not where it failed before; where a kind of backend is
// named, on that kind; on another only where fallback is allowed and no device of the named kind is left that serves
// and has not failed it.
bool MayHave(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving);

// True if the worker that has the task is of another kind than the one it was meant for: the one that it names or,
// where it leaves that open, that of a device that failed it.
bool IsFallback(const TaskTraits& task, const WorkerTraits& worker);

// True if any of the devices may have it.
bool AnyMayHave(const TaskTraits& task, std::span<const ServingDevice> serving);

// What is thought of the workers of one kind that may have a task which leaves the device open. Milliseconds are
// predicted, as corrected by what that kind of device took for jobs of this size.
struct KindOutlook {
  size_t workers = 0;     // that serve
  size_t idle = 0;        // of these
  double free_in_ms = 0;  // until the first of them has no batch; 0 where one is idle
  double task_ms = 0;     // the task itself
  double waiting_ms = 0;  // all that waits for this kind, the task included
};

// When the GPUs would be done with all that waits for them.
double GpusDoneInMs(const KindOutlook& gpu);

// True if a worker that may have the task and has nothing else to do had better leave it to the other kind, because it
// ends earlier there. A CPU worker leaves what it would not end before the GPUs have ended all that waits; a GPU leaves
// to idle CPU workers what these do sooner, if there is one for each of the `waiting` tasks. Where all are idle, one of
// them does not leave it.
bool LeavesToOtherKind(BackendChoice kind, const KindOutlook& cpu, const KindOutlook& gpu, size_t waiting);

}  // namespace voxelpipe
