// The isometric view of the preview.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_volume.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// A rectangle of the canvas, pixels.
struct PixelRect {
  int x = 0, y = 0, width = 0, height = 0;
};

// Voxel size per axis over the smallest one, limited to 1000 so that grids of needles can be drawn.
Vec3d RelativeVoxelSize(const GridSpec& grid);

// Draws the solid voxels with a ground shadow into `rect` (samples^2 rays a pixel), and the three axes into its corner.
absl::Status DrawIsometric(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid,
                           const PixelRect& rect, int samples, const JobContext* job, Canvas& canvas);

}  // namespace voxelpipe
