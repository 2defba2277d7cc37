// The part of a list that one run of `voxelpipe batch` processes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace voxelpipe::cli {

// Every n-th item, from the i-th on. The shards 0/n to n-1/n cover a manifest, and so do 1/n to n/n.
struct Shard {
  uint64_t index = 0, count = 1;
  bool Holds(size_t item) const { return item % count == index % count; }
};

// The value of a variable of the environment; empty if it is not set.
using Environment = std::function<std::optional<std::string>(const char* name)>;
std::optional<std::string> ProcessEnvironment(const char* name);

// In: "i/n" with n at least 1 and i at most n, or "auto": the task of an array job of Slurm (SLURM_ARRAY_TASK_ID, _MIN,
// _COUNT; _STEP where the array has one), or the pod of an Indexed Job of Kubernetes (JOB_COMPLETION_INDEX, and
// VOXELPIPE_SHARDS, the number of its completions). INVALID_ARGUMENT otherwise; it names the variables that are missing
// or wrong, and an array whose numbers have gaps.
absl::StatusOr<Shard> ParseShard(const std::string& text, const Environment& environment = &ProcessEnvironment);

}  // namespace voxelpipe::cli
