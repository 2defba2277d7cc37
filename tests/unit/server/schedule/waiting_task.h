// A task for tests of the queue: does nothing, and records its outcome.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "schedule/task.h"

namespace voxelpipe::testing {

class WaitingTask final : public Task {
 public:
  bool loaded() const override { return is_loaded; }
  bool Load() override { return true; }
  void Refuse(absl::Status why) override { refused.push_back(std::move(why)); }

  bool is_loaded = true;
  std::vector<absl::Status> refused;
};

inline std::shared_ptr<WaitingTask> MakeTask(const std::string& client = "a", Priority priority = Priority::kNormal,
                                             double run_ms = 1) {
  auto task = std::make_shared<WaitingTask>();
  task->traits.client = client;
  task->traits.priority = priority;
  task->traits.cost.run_ms = run_ms;
  return task;
}

}  // namespace voxelpipe::testing
