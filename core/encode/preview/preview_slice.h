// The slices of the preview.
#pragma once

#include "absl/status/status.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_volume.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// Draws the slices of index dims/2 across x, y and z below each other into `column`: x seen from +X, y from +Y, z from
// +Z; for x and z +Y is up, for y -Z is up. Each has a caption ("x = 64") and two arrows along its edges, which point
// along the grid's axes and have their letter and their range in index space: 0 and the number of voxels. A pixel
// smaller than a voxel shows the voxel, a larger one the average of those it covers. The paper is white, or, where that
// hides the voxels, the one of three tones that they stand out from best. Errors: the job's, to whose memory a colour a
// pixel is charged; it may be null.
absl::Status DrawSlices(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid,
                        const PixelRect& column, const JobContext* job, Canvas& canvas);

}  // namespace voxelpipe
