// The header of NRRD files.
#pragma once

#include <string>

#include "job/result.h"

namespace voxelpipe {

// In: the header of a dense result with one target. Out: the fields of its NRRD file, each a line, without the empty
// line that ends the header. The data are gzip of plain elements (PlainElements). The axes are those of .nii.gz:
// programs that turn them, as ITK does, place both files alike.
std::string NrrdFields(const ResultHeader& header);

}  // namespace voxelpipe
