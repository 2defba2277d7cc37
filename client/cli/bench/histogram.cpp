#include "bench/histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace voxelpipe::cli {
namespace {

constexpr int kSubBits = 8;                           // 2^8 buckets per octave
constexpr uint64_t kExact = uint64_t{2} << kSubBits;  // values below have a bucket each
constexpr size_t kBuckets = kExact + (64 - kSubBits - 1) * (size_t{1} << kSubBits);

size_t BucketOf(uint64_t value) {
  if (value < kExact) return size_t(value);
  const int shift = std::bit_width(value) - 1 - kSubBits;  // at least 1
  return (size_t(shift) << kSubBits) + size_t(value >> shift);
}

// The largest value of a bucket.
uint64_t UpperEdge(size_t bucket) {
  if (bucket < kExact) return bucket;
  const int shift = int(bucket >> kSubBits) - 1;
  const uint64_t mantissa = bucket - (size_t(shift) << kSubBits);
  return (mantissa << shift) + ((uint64_t{1} << shift) - 1);
}

}  // namespace

Histogram::Histogram() : buckets_(kBuckets) {}

void Histogram::Add(uint64_t value) {
  ++buckets_[BucketOf(value)];
  ++count_;
  max_ = std::max(max_, value);
  sum_ += double(value);
}

void Histogram::Merge(const Histogram& other) {
  for (size_t i = 0; i < kBuckets; ++i) buckets_[i] += other.buckets_[i];
  count_ += other.count_;
  max_ = std::max(max_, other.max_);
  sum_ += other.sum_;
}

double Histogram::Mean() const {
  return count_ == 0 ? 0 : sum_ / double(count_);
}

uint64_t Histogram::Percentile(double p) const {
  if (count_ == 0) return 0;
  const uint64_t wanted = std::clamp<uint64_t>(uint64_t(std::ceil(p * double(count_))), 1, count_);
  uint64_t seen = 0;
  for (size_t i = 0; i < kBuckets; ++i) {
    seen += buckets_[i];
    if (seen >= wanted) return std::min(UpperEdge(i), max_);
  }
  return max_;
}

}  // namespace voxelpipe::cli
