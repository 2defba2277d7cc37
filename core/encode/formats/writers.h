// The writers of the formats, for the registry. Each takes a path, empty for standard output, and a job that may be
// null; Begin creates the file and refuses results that the format cannot hold with INVALID_ARGUMENT.
#pragma once

#include <memory>
#include <string>

#include "encode/result_file.h"

namespace voxelpipe {

// Dense: each array's bytes as they are, one file a target, and PATH.json, which describes them all.
std::unique_ptr<ResultFile> MakeRawFile(const std::string& path, const JobContext* job);
// Dense: one file a target; bits as uint8 0/1.
std::unique_ptr<ResultFile> MakeNpyFile(const std::string& path, const JobContext* job);
// Any kind: target0, target1, ...; sparse: ijk int32 (n, 3) in x, y, z; buckets: ijk, offsets int64 (n + 1), triangle
// uint32 (m); always dims int64 (3), origin and voxel_size float64 (3), index_to_world float64 (4, 4).
std::unique_ptr<ResultFile> MakeNpzFile(const std::string& path, const JobContext* job);

}  // namespace voxelpipe
