// Results in files: what WriteResult wrote, without reading the arrays.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "encode/read/stored_array.h"
#include "job/request.h"

namespace voxelpipe {

struct StoredTarget {
  StoredArray array;
  int components = 1;
  bool planar = false;
};

struct StoredResult {
  struct Place {
    Vec3d origin, voxel_size;  // world units
    friend bool operator==(const Place&, const Place&) = default;
  };
  std::string path;
  ResultKind kind = ResultKind::kDense;
  std::array<int64_t, 3> dims{1, 1, 1};  // nx, ny, nz
  std::optional<Place> place;            // a .npy has none
  std::vector<StoredTarget> targets;
  // Of sparse results and buckets: (n, 3), x y z; of buckets: (n + 1), (m).
  StoredArray ijk, offsets, triangle;

  uint64_t voxels() const { return uint64_t(dims[0]) * uint64_t(dims[1]) * uint64_t(dims[2]); }
  uint64_t listed() const { return ijk.shape.empty() ? 0 : ijk.shape[0]; }
};

// In: the path of a .npy (one target, dense), a .npz (any kind), a .raw or its .raw.json (dense; of several targets the
// name that was given for the output: OUT.raw, not OUT.0.raw). Out: its arrays, their shapes checked against dims and
// each other; the elements are not read. An axis of components has 1 to 4 elements; where both the first and the last
// axis could be it, it is the last. Memory: at most some megabytes. Errors, with path and array: INVALID_ARGUMENT for
// what is no such file, those of InputFile.
absl::StatusOr<StoredResult> OpenResult(const std::string& path);

}  // namespace voxelpipe
