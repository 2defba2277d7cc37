// Timers of waiting tasks.
#pragma once

#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "schedule/task.h"

namespace voxelpipe {

// At most one time per task. Not thread-safe; no thread and no clock of its own.
class QueueTimers {
 public:
  using Time = JobContext::Clock::time_point;

  void Set(const Task& task, Time when) {
    Clear(task);
    times_[&task] = when;
    order_.emplace(when, &task);
  }
  void Clear(const Task& task) {
    const auto it = times_.find(&task);
    if (it == times_.end()) return;
    order_.erase({it->second, &task});
    times_.erase(it);
  }
  std::optional<Time> Next() const {
    if (order_.empty()) return std::nullopt;
    return order_.begin()->first;
  }
  // Removes and returns a task whose time has come; null if there is none.
  const Task* PopDue(Time now) {
    if (order_.empty() || order_.begin()->first > now) return nullptr;
    const Task* task = order_.begin()->second;
    Clear(*task);
    return task;
  }
  size_t size() const { return order_.size(); }

 private:
  std::set<std::pair<Time, const Task*>> order_;
  std::unordered_map<const Task*, Time> times_;
};

}  // namespace voxelpipe
