// The shaded view of the preview.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_cells.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_view.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// Draws the solid voxels into `rect`, seen from `view`, with a shadow on the ground unless the ground is seen from
// below or edge-on, and the three axes into the corner. One ray a pixel, samples^2 of them where neighbours differ. The
// picture does not depend on the number of threads. Errors: the job's, to whose memory a
// colour a pixel is charged.
absl::Status DrawView(const PreviewCells& cells, const PreviewColours& colours, const GridSpec& grid,
                      const PreviewView& view, const PixelRect& rect, int samples, const JobContext* job,
                      Canvas& canvas);

}  // namespace voxelpipe
