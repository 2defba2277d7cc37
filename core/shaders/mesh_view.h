// The mesh as shaders see it: plain pointers, the same struct on both devices.
#pragma once

#include <cstdint>

#include "base/vec.h"

namespace voxelpipe {

// 8-bit RGBA texels, rows from the top. width == 0: no image, every sample is white.
struct TextureView {
  const uint8_t* rgba = nullptr;
  uint32_t width = 0, height = 0;
  uint8_t wrap_s = 0, wrap_t = 0;  // enumerators of WrapMode
  bool nearest = false;
};

struct TextureRefView {
  int32_t texture = -1;
  int32_t uv_set = 0;
  // uv' = m * (u, v, 1), from KHR_texture_transform.
  float m[2][3] = {{1, 0, 0}, {0, 1, 0}};
};

struct MaterialView {
  Vec4f base_color_factor{1, 1, 1, 1};
  TextureRefView base_color;
  float alpha_cutoff = 0;
  bool alpha_mask = false;  // discard fragments whose alpha is below the cutoff
};

// A run of triangles from one primitive of one node instance (MeshPart).
struct PartView {
  uint64_t first_triangle = 0;
  int32_t material = 0;  // index into materials; the default material stands at the end of the array
  uint32_t mesh = 0;
  bool has_normals = false, has_colors = false;
};

// Arrays are owned by the backend and live as long as the run. An attribute pointer is null if no part has it.
struct MeshView {
  const Vec3d* positions = nullptr;  // shaded, world space
  const Vec3f* normals = nullptr;    // shaded, world space
  const Vec2f* uv[2] = {nullptr, nullptr};
  const Vec4f* colors = nullptr;
  const uint32_t (*triangles)[3] = nullptr;
  const PartView* parts = nullptr;
  const MaterialView* materials = nullptr;
  const TextureView* textures = nullptr;
  uint64_t vertex_count = 0, triangle_count = 0;
  uint32_t part_count = 0, material_count = 0, texture_count = 0;
};

// The part that a triangle belongs to, by bisection.
VOXELPIPE_HD uint32_t PartOf(const MeshView& mesh, uint64_t triangle) {
  uint32_t lo = 0, hi = mesh.part_count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (mesh.parts[mid].first_triangle <= triangle) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  return lo;
}

}  // namespace voxelpipe
