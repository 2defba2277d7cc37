// The remaining room of a batch.
#pragma once

#include <cstddef>
#include <cstdint>

#include "schedule/task.h"

namespace voxelpipe {

struct BatchLimits {
  size_t jobs = 1;
  double ms = 0;              // total predicted work
  uint64_t bytes = 0;         // of the results
  uint64_t device_bytes = 0;  // 0 = no limit
};

class BatchRoom {
 public:
  explicit BatchRoom(const BatchLimits& limits) : limits_(limits) {}

  // The first one always fits.
  bool Fits(const JobCost& cost, double ms) const {
    if (jobs_ == 0) return true;
    return jobs_ < limits_.jobs && ms_ + ms <= limits_.ms && cost.output_bytes <= limits_.bytes &&
           bytes_ <= limits_.bytes - cost.output_bytes &&
           (limits_.device_bytes == 0 ||
            (cost.device_bytes <= limits_.device_bytes && device_bytes_ <= limits_.device_bytes - cost.device_bytes));
  }
  void Add(const JobCost& cost, double ms) {
    ++jobs_;
    ms_ += ms;
    bytes_ += cost.output_bytes;
    device_bytes_ += cost.device_bytes;
  }
  double ms() const { return ms_; }

 private:
  const BatchLimits limits_;
  size_t jobs_ = 0;
  double ms_ = 0;
  uint64_t bytes_ = 0, device_bytes_ = 0;
};

}  // namespace voxelpipe
