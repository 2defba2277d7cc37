// The part of a fragment shader's input that depends on the triangle alone: made once for all its fragments.
#pragma once

#include <cmath>

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Change of the texture coordinates along one voxel: the square root of the triangle's area in uv over its area in
// index space, which is the geometric mean of the mapping's two singular values. 0 if either area is 0 or NaN; at most
// 2^60.
VOXELPIPE_HD float UvDensity(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec2f& uv_a, const Vec2f& uv_b,
                             const Vec2f& uv_c) {
  const Vec3d n = Cross(b - a, c - a);
  const double area = sqrt(Dot(n, n));
  const double du1 = double(uv_b.x) - double(uv_a.x), dv1 = double(uv_b.y) - double(uv_a.y);
  const double du2 = double(uv_c.x) - double(uv_a.x), dv2 = double(uv_c.y) - double(uv_a.y);
  const double uv_area = Abs(du1 * dv2 - du2 * dv1);
  if (!(area > 0) || !(uv_area > 0)) return 0;
  const double density = sqrt(uv_area / area);
  return density < 0x1p60 ? float(density) : (density >= 0x1p60 ? 0x1p60f : 0.0f);
}

// The input that needs no geometry: mesh, part, triangle and vertices (for shaders without
// FragmentShaderTraits::kNeedsPlane).
VOXELPIPE_HD FragmentInput MakePlainInput(const MeshView& mesh, uint32_t triangle) {
  FragmentInput in;
  in.mesh = &mesh;
  in.part = &mesh.parts[PartOf(mesh, triangle)];
  in.triangle = triangle + in.part->id_offset;
  for (int i = 0; i < 3; ++i) in.vertex[i] = mesh.triangles[triangle][i];
  return in;
}

// In: a triangle of `mesh`; `degenerate` if it is so in index space (raster/triangle_plane.h); `textured` if a shader
// samples textures. Out: everything but the voxel and the barycentrics. uv_density is 0 for degenerate triangles.
VOXELPIPE_HD FragmentInput MakeFragmentInput(const MeshView& mesh, uint32_t triangle, bool degenerate, bool textured) {
  FragmentInput in = MakePlainInput(mesh, triangle);
  in.degenerate = degenerate;
  if (degenerate) return in;
  const Vec3d* p = mesh.positions;
  in.geometric_normal = TriangleNormal(p[in.vertex[0]], p[in.vertex[1]], p[in.vertex[2]]);
  if (!textured) return in;
  const Vec3d* index = mesh.index_positions;
  for (int set = 0; set < 2; ++set) {
    const Vec2f* uv = mesh.uv[set];
    if (!in.part->has_uv[set]) continue;
    in.uv_density[set] = UvDensity(index[in.vertex[0]], index[in.vertex[1]], index[in.vertex[2]], uv[in.vertex[0]],
                                   uv[in.vertex[1]], uv[in.vertex[2]]);
  }
  return in;
}

}  // namespace voxelpipe
