// checker: a three-dimensional checkerboard, to see scale and orientation of a grid.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Parameters: size, edge of a cell in voxels, a whole number; even and odd, the values of the cells. Cells begin at
// voxel (0, 0, 0), whose cell is even; neighbours across a face differ. Output: f32, 1 component. Needs nothing of the
// mesh.
struct CheckerShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams& params, FragmentOutput& out) {
    const int64_t size = int64_t(params.value[0]);
    const int64_t cell = in.voxel[0] / size + in.voxel[1] / size + in.voxel[2] / size;
    out.f[0] = float(params.value[cell % 2 == 0 ? 1 : 2]);
  }
};

}  // namespace voxelpipe
