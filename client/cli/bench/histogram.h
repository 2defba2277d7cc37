// Counts of values over buckets of equal relative width, after G. Tene's HdrHistogram: constant memory however long a
// run is.
#pragma once

#include <cstdint>
#include <vector>

namespace voxelpipe::cli {

// Not thread-safe: one a thread, merged at the end.
class Histogram {
 public:
  Histogram();

  // Values below 512 keep their own bucket, larger ones share it with those up to 1/256 larger.
  void Add(uint64_t value);
  void Merge(const Histogram& other);

  uint64_t count() const { return count_; }
  uint64_t max() const { return max_; }  // exact; 0 where nothing was added
  double Mean() const;                   // exact up to rounding; 0 where nothing was added
  // In: p in [0, 1]. Out: a value that at least p of all values do not exceed, too large by 0.4 % at most and never too
  // small; 0 where nothing was added.
  uint64_t Percentile(double p) const;

 private:
  std::vector<uint64_t> buckets_;
  uint64_t count_ = 0, max_ = 0;
  double sum_ = 0;
};

}  // namespace voxelpipe::cli
