// A picture of a result: a shaded view and the three mid slices, in one PNG, without OpenGL.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "encode/preview/png_writer.h"
#include "encode/preview/preview_view.h"
#include "job/result.h"

namespace voxelpipe {

struct PreviewOptions {
  int width = 1280, height = 960;  // pixels, each at least 64
  int samples = 2;                 // rays a pixel and axis (antialiasing), where neighbouring pixels differ
  PreviewView view{};              // the camera
};

// In: a result of any kind with at least one target. Solid voxels: in a dense result the set bits of the first bit
// target, or without one the voxels of the first target with a component that is not `clear`; in a sparse or bucketed
// result the listed voxels, with the last fragment of a bucket. Colour: the first target with 3 or 4 components as
// linear RGB (integers over their `scale`, by default their largest value; unit vectors of the normal shaders mapped to
// [0, 1]; of velocities the length, through a colour map); otherwise the first other target that is not bits, if it
// holds the labels of parts (legend.h) in their colours, with a legend of labels and names in the picture, else through
// a colour map from its smallest to its largest value other than `clear`; otherwise, of buckets, the number of
// fragments through that map, from 1 to the largest on a logarithmic scale; otherwise one clay colour. Voxels inside a
// solid that hold `clear` have a pale blue of their own. Normals for lighting: those of a u16, u32 or f32 target of
// `packed_normal` (blends replace, first, min, max), otherwise those of the voxels' shape. Out: the picture, sRGB, from
// options.view. The slices are those of index n/2, as DrawSlices draws them: x seen from +X, y from +Y, z from +Z. The
// picture does not depend on the number of threads. Time: linear in the pixels, and one pass over the bits of the
// voxels. Errors: INVALID_ARGUMENT for options out of range or a result without targets; CANCELLED; DEADLINE_EXCEEDED;
// RESOURCE_EXHAUSTED out of memory.
absl::StatusOr<Picture> RenderPreview(const VoxelizeResult& result, const PreviewOptions& options = {},
                                      const JobContext* job = nullptr);

// RenderPreview into a PNG file, under a temporary name and then renamed. Errors: also the system's, with the path.
absl::Status WritePreview(const VoxelizeResult& result, const std::string& path, const PreviewOptions& options = {},
                          const JobContext* job = nullptr);

}  // namespace voxelpipe
