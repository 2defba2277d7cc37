// The slices of the preview.
#pragma once

#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_shade.h"
#include "encode/preview/preview_volume.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// Draws the slice of index dims[axis]/2 across `axis` into `rect` with its caption: x seen from +X, y from +Y, z from
// +Z; for x and z +Y is up, for y -Z is up. A pixel smaller than a voxel shows the voxel, a larger one the average of
// those it covers.
void DrawSlice(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid, int axis,
               const PixelRect& rect, Canvas& canvas);

}  // namespace voxelpipe
