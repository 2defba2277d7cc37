// The files that a run of `voxelpipe voxelize` writes.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "encode/preview/preview_view.h"
#include "job/request.h"
#include "options/input_list.h"

namespace voxelpipe::cli {

struct OutputPlan {
  std::string result;           // path for WriteResult, empty = none
  std::string preview;          // path of the picture, empty = none
  std::string standard_output;  // extension of the format in which the result goes there, empty = it does not
  PreviewView view{};           // the camera of pictures
};

// What was typed; empty if not given.
struct OutputNames {
  std::string output, preview;
  std::string format;  // a name of core/encode/format_registry.h, as npy
  std::string view{};  // of every picture
};

// One plan for each input, in order. With several inputs or an open-ended list, or if it is an existing directory or
// ends in '/', `output` and `preview` are directories each: files there have the input's name (and the extension of
// `format`, by default .npy for dense results, .npz for others; .png for pictures). The output "-" is standard output.
// Errors: INVALID_ARGUMENT for an extension that cannot hold the result of the request, for a
// file name where a directory is needed, for a format that is not that of the file, for standard output without a
// format or where it cannot hold all results, for two outputs of the same name, for an output that is its input,
// and for a view that is none or has no picture.
absl::StatusOr<std::vector<OutputPlan>> PlanOutputs(const InputList& inputs, const OutputNames& names,
                                                    const VoxelizeRequest& request = {});

}  // namespace voxelpipe::cli
