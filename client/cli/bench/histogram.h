// Counts of values over buckets of equal relative width, after G. Tene's HdrHistogram: constant memory for runs of any
// length.
#pragma once

#include <cstdint>
#include <vector>

namespace voxelpipe::cli {

// Not thread-safe: one per thread, merged at the end.
class Histogram {
 public:
  Histogram();

  // Values below 512 have a bucket each; buckets of larger ones are 1/256 of the value wide.
  void Add(uint64_t value);
  void Merge(const Histogram& other);

  uint64_t count() const { return count_; }
  uint64_t max() const { return max_; }  // exact; 0 if empty
  double Mean() const;                   // exact up to rounding; 0 if empty
  // In: p in [0, 1]. Out: an upper bound of the p-quantile, at most 0.4 % too large; 0 if empty.
  uint64_t Percentile(double p) const;

 private:
  std::vector<uint64_t> buckets_;
  uint64_t count_ = 0, max_ = 0;
  double sum_ = 0;
};

}  // namespace voxelpipe::cli
