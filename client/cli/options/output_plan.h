// The files that a run of `voxelpipe voxelize` writes.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"

namespace voxelpipe::cli {

struct OutputPlan {
  std::string result;   // path for WriteResult, empty = none
  std::string preview;  // path of the picture, empty = none
};

// One plan for each input, in order. `output` and `preview` as typed, empty if not given. With several inputs, or if it
// is an existing directory or ends in '/', each of the two is a directory: files there have the input's stem as name
// (.npy for dense results, .npz for others, .png for pictures), with "-2", "-3", ... appended if a name is taken.
// Errors: INVALID_ARGUMENT for an extension that cannot hold the result, and for a file name where a directory is
// needed.
absl::StatusOr<std::vector<OutputPlan>> PlanOutputs(const std::vector<std::string>& inputs, const std::string& output,
                                                    const std::string& preview, ResultKind kind = ResultKind::kDense);

}  // namespace voxelpipe::cli
