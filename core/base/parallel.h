// A parallel loop that stops early when the job should end.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <cstdint>

#include "absl/status/status.h"
#include "base/job_context.h"

namespace voxelpipe {

// Calls body(begin, end) for chunks of at most `grain` of [0, count), in any order, checking the job before each chunk.
// Out: OK, or the reason why the job ended; started chunks finish, the others never run.
template <typename Body>
absl::Status ParallelChunks(int64_t count, int64_t grain, const JobContext& job, const Body& body) {
  std::atomic<bool> stop{false};
  tbb::parallel_for(
      tbb::blocked_range<int64_t>(0, count, size_t(grain)),
      [&](const tbb::blocked_range<int64_t>& range) {
        if (stop.load(std::memory_order_relaxed)) return;
        if (!job.Check().ok()) {
          stop.store(true, std::memory_order_relaxed);
          return;
        }
        body(range.begin(), range.end());
      },
      tbb::simple_partitioner());
  return stop.load() ? job.Check() : absl::OkStatus();
}

}  // namespace voxelpipe
