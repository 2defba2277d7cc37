// Which files a run of `voxelpipe voxelize` writes.
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

// One plan for each input, in order. `output` and `preview` as typed, empty where not given. With several inputs, or
// where it is an existing directory or ends in '/', each of the two is a directory: files there are named after the
// input's stem (.npy for dense results, .npz for others, .png for pictures), "-2", "-3", ... appended where a name is
// taken. Errors: INVALID_ARGUMENT for an extension that cannot hold the result, and for a file's name where a directory
// is needed.
absl::StatusOr<std::vector<OutputPlan>> PlanOutputs(const std::vector<std::string>& inputs, const std::string& output,
                                                    const std::string& preview, ResultKind kind = ResultKind::kDense);

}  // namespace voxelpipe::cli
