// Proves that the arithmetic of core/raster and core/shaders is device code: it compiles under nvcc, warnings being
// errors, and every entry point is instantiated in a kernel. Nothing here runs; no GPU is needed.
#include "raster/crossing.h"
#include "raster/spans.h"
#include "raster/tiles.h"
#include "shaders/blend_ops.h"
#include "shaders/shader_list.h"

namespace voxelpipe {

__global__ void RasterizeOne(const Vec3d* corners, Coverage coverage, VoxelRange within, int64_t* voxels) {
  const TriangleSetup setup = SetUpTriangle(corners[0], corners[1], corners[2], coverage);
  int64_t count = 0;
  ForEachRowSpan(setup, within, [&](int64_t, int64_t, int64_t begin, int64_t end) { count += end - begin; });
  *voxels = count;
}

__global__ void CrossOne(const Vec3d* corners, Coverage coverage, double y, double z, int64_t nx, int64_t* toggled) {
  const TriangleSetup setup = SetUpTriangle(corners[0], corners[1], corners[2], coverage);
  *toggled = 0;
  if (LineCrosses(corners[0], corners[1], corners[2], y, z)) {
    *toggled = CentresBefore(CrossingX(setup, corners[0], corners[1], corners[2], y, z), nx);
  }
}

__global__ void BlendOne(const FragmentOutput* fragment, bool is_u32, double quantum, float* kept) {
  const float value = ToF32(*fragment, is_u32, 0);
  kept[0] = ToBit(*fragment, is_u32) ? 1.0f : 0.0f;
  kept[1] = BlendMin(kept[1], value);
  kept[2] = BlendMax(kept[2], value);
  kept[3] = Dequantize(Quantize(value, quantum), quantum);
}

__global__ void ShadeOne(FragmentShaderId id, FragmentInput in, ShaderParams params, FragmentOutput* out) {
  ShadeFragment(id, in, params, *out);
}

__global__ void ShadeVertexOne(VertexShaderId id, ShadedVertex in, ShaderParams params, ShadedVertex* out) {
  *out = ShadeVertex(id, in, params);
}

}  // namespace voxelpipe
