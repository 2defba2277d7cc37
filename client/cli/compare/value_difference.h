// Values of two results at one voxel.
#pragma once

#include <span>
#include <vector>

#include "compare/comparison.h"

namespace voxelpipe::cli {

// The values of one target from front to back.
class TargetReader {
 public:
  explicit TargetReader(const StoredTarget& target);

  // Fills `out`, one number a component, with the next voxel's or fragment's.
  absl::Status Next(std::span<double> out);
  void Skip(uint64_t elements);
  int components() const { return components_; }

 private:
  int components_;
  std::vector<ArrayReader> readers_;  // one, of planar targets one a component
};

// The values of all targets of two results: `a` and `b` hold those of the current element.
class ValuePair {
 public:
  ValuePair(const StoredResult& a, const StoredResult& b, double tolerance);

  absl::Status NextA() { return Next(readers_a_, a_); }
  absl::Status NextB() { return Next(readers_b_, b_); }
  void SkipA(uint64_t elements);
  void SkipB(uint64_t elements);

  // The first target that differs by more than the tolerance, or -1. Takes all differences into `values`. Only where
  // both have the same numbers of components.
  int Difference(ComparedValues& values) const;
  bool OccupiedA() const { return Occupied(a_); }
  bool OccupiedB() const { return Occupied(b_); }
  // The components of a target of the current elements.
  const std::vector<double>& a(int target) const { return a_[size_t(target)]; }
  const std::vector<double>& b(int target) const { return b_[size_t(target)]; }

 private:
  using Numbers = std::vector<std::vector<double>>;  // by target and component
  static absl::Status Next(std::vector<TargetReader>& readers, Numbers& numbers);
  static bool Occupied(const Numbers& numbers);

  double tolerance_;
  std::vector<TargetReader> readers_a_, readers_b_;
  Numbers a_, b_;
};

}  // namespace voxelpipe::cli
