// The comparison of two results.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "encode/read/stored_result.h"

namespace voxelpipe::cli {

// Occupied: of dense results, a component of a target is not 0 (NaN is not); of the others, listed.
struct ComparedOccupancy {
  uint64_t a = 0, b = 0, only_a = 0, only_b = 0;  // voxels
  double iou() const;                             // of both over that of either; 1 if neither has any
};

struct ComparedValues {
  uint64_t compared = 0;   // voxels: all of dense results, of the others those in both
  uint64_t differing = 0;  // voxels with a component that differs by more than the tolerance, or with other fragments
  double largest = 0;      // absolute difference of two components; NaN is left out
};

// The first voxel that differs in values or is in one result only, in the order of the file.
struct FirstDifference {
  std::array<int64_t, 3> ijk{};
  int target = 0;
  std::vector<double> a, b;  // the components there; empty if the voxel is not in that result
  std::string note;          // of buckets, what differs
};

struct Comparison {
  bool same_dims = false;
  std::optional<bool> same_place;  // absent if a file has none
  bool same_targets = false;       // number, components, and types; packed bits equal bytes
  std::optional<ComparedOccupancy> occupancy;
  std::optional<ComparedValues> values;  // absent if the numbers of targets or components differ
  std::optional<FirstDifference> first;

  bool equal() const;
};

// In: two results of one kind, and the largest difference that is none (finite, at least 0). Reads both in pieces: some
// 100 KiB a component, whatever the size. NaN equals NaN and differs from all else; -0 equals 0. Dims that differ leave
// occupancy and values out. Errors: INVALID_ARGUMENT for two kinds, or a list that is not in order or leaves the grid,
// with file and element; those of ArrayReader; the job's.
absl::StatusOr<Comparison> Compare(const JobContext& job, const StoredResult& a, const StoredResult& b,
                                   double tolerance);

}  // namespace voxelpipe::cli
