// The settings that slicers store beside the model: which parts of it are no solids.
#pragma once

#include "absl/status/status.h"
#include "base/warning.h"
#include "load/base/load_budget.h"
#include "load/threemf/zip_archive.h"

namespace voxelpipe::threemf {

// Adds a warning for each part that a slicer cuts away (PrusaSlicer's NegativeVolume, the negative_part of Bambu Studio
// and OrcaSlicer), or only reads settings or supports from, by its name: its triangles are in the model as those of a
// solid. Settings that are no XML are a warning too. Errors: RESOURCE_EXHAUSTED; the job's.
absl::Status WarnOfSlicerParts(ZipArchive& archive, LoadBudget& budget, WarningList& warnings);

}  // namespace voxelpipe::threemf
