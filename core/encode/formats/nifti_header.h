// The header of a NIfTI file.
#pragma once

#include <string>

#include "job/result.h"

namespace voxelpipe {

// In: the header of a dense result with one target. Out: the 352 bytes before the voxels of a NIfTI-1 file, or the 544
// bytes of a NIfTI-2 file if a dim exceeds 32,767 or float32 places the voxels more than a thousandth of one away.
std::string NiftiHeader(const ResultHeader& header);

}  // namespace voxelpipe
