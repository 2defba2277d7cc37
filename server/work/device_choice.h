// Which devices may have a task. The rules of backend and fallback stand here and nowhere else.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "pipeline/request.h"
#include "work/task.h"

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

// Whether a worker may have the task while these devices serve. Not where it failed before; where a kind of backend is named, on that kind;
// on another only where fallback is allowed and no device of the named kind is left that serves and has not failed it.
bool MayHave(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving);

// Whether the worker that has the task is of another kind than the one it was meant for: the one that it names or, where it leaves that
// open, that of a device that failed it.
bool IsFallback(const TaskTraits& task, const WorkerTraits& worker);

// Whether any of the devices may have it.
bool AnyMayHave(const TaskTraits& task, std::span<const ServingDevice> serving);

// Whether a worker that may have the task had better leave it: a CPU worker leaves to the GPUs what they can take with their next
// batches, and helps when more waits than that. `waiting`: tasks that wait for any device; `max_batch_jobs`: of one batch.
bool LeavesToGpus(const TaskTraits& task, const WorkerTraits& worker, std::span<const ServingDevice> serving,
                  size_t waiting, size_t max_batch_jobs);

}  // namespace voxelpipe
