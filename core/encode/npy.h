// NumPy's .npy files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "encode/atomic_file.h"
#include "pipeline/voxelize.h"

namespace voxelpipe {

// Magic, version, length and the Python dictionary of a C-ordered array, padded so that the data starts at a multiple
// of 64 bytes. `descr` is NumPy's type string ("|u1", "<f4"). Version 1.0, or 2.0 where the dictionary exceeds 65,535
// bytes.
std::string NpyHeader(std::string_view descr, const std::vector<uint64_t>& shape);

// The NumPy shape of a target: (nz, ny, nx) for one component, (nz, ny, nx, c) interleaved, (c, nz, ny, nx) planar.
std::vector<uint64_t> NpyShape(const GridSpec& grid, const TargetSpec& target, Layout layout);

// Appends target `index` of `result` to `file` as a .npy: bit as uint8 0/1, f32 as '<f4'. Needs a few megabytes of
// memory whatever the size of the target.
absl::Status WriteNpy(const VoxelizeResult& result, size_t index, AtomicFile& file, const JobContext* job);

}  // namespace voxelpipe
