// The mesh as shaders read it: plain pointers, the same struct on both devices.
#pragma once

#include <cstdint>

#include "base/vec.h"
#include "mesh/scene/attribute_run.h"

namespace voxelpipe {

// 8-bit RGBA texels, rows from the top. width == 0: no image, every sample is white.
struct TextureView {
  const uint8_t* rgba = nullptr;  // level 0
  const Vec4f* mips = nullptr;  // levels 1 and on, one after the other, linear; null: level 0 alone (mesh/views/mips.h)
  uint32_t width = 0, height = 0;
  uint32_t levels = 1;             // including level 0
  uint8_t wrap_s = 0, wrap_t = 0;  // enumerators of WrapMode
  uint8_t mip_filter = 0;          // enumerator of MipFilter
  bool nearest = false;            // at most one texel a voxel: the nearest texel, otherwise bilinear
  bool min_nearest = false;        // more texels a voxel: the same, within a level
  bool srgb = false;               // the colours of `rgba` are sRGB, otherwise linear; alpha is linear
};

struct TextureRefView {
  int32_t texture = -1;  // index into MeshView::textures
  int32_t uv_set = 0;
  // uv' = m * (u, v, 1), from KHR_texture_transform.
  float m[2][3] = {{1, 0, 0}, {0, 1, 0}};
  float texels = 0;  // sqrt(|det m| * width * height): level-0 texels along a unit of uv, before the transform
};

struct MaterialView {
  Vec4f base_color_factor{1, 1, 1, 1};
  Vec3f emissive_factor{0, 0, 0};  // times KHR_materials_emissive_strength
  float metallic_factor = 1, roughness_factor = 1;
  TextureRefView base_color, emissive, metallic_roughness;
  float alpha_cutoff = 0;
  bool alpha_mask = false;  // discard fragments whose alpha is below the cutoff
};

// A run of triangles from one primitive of one node instance (MeshPart).
struct PartView {
  uint64_t first_triangle = 0;
  int32_t material = 0;  // index into materials; the default material stands at the end of the array
  uint32_t mesh = 0;
  uint32_t label = 1;  // of the part of the request that it belongs to
  // Where parts are filled (host_mesh/order_parts.h): the rank of its part plus 1, and what leads from the number of a
  // triangle here to its id, modulo 2^32.
  uint32_t rank = 0, id_offset = 0;
  bool has_normals = false, has_tangents = false, has_colors = false;
  bool has_uv[2] = {false, false};
};

// An application-specific vertex attribute: `components` floats a vertex, 0 in parts without it.
struct AttributeView {
  const float* values = nullptr;
  int32_t components = 1;  // 1-4
  uint32_t run_count = 0;  // 0: all vertices have values
  const AttributeRun* runs = nullptr;
};

// The values of a vertex, null if it has none; by binary search.
VOXELPIPE_HD const float* ValuesOf(const AttributeView& attribute, uint64_t vertex) {
  if (attribute.run_count == 0) return attribute.values + vertex * uint64_t(attribute.components);
  uint32_t lo = 0, hi = attribute.run_count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (attribute.runs[mid].first_vertex <= vertex) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  const AttributeRun& run = attribute.runs[lo];
  if (vertex < run.first_vertex || vertex >= run.end_vertex) return nullptr;
  return attribute.values + run.first_value + (vertex - run.first_vertex) * uint64_t(attribute.components);
}

// The number of its values in a mesh of `vertices` vertices. Host only.
inline uint64_t ValueCount(const AttributeView& attribute, uint64_t vertices) {
  if (attribute.run_count == 0) return vertices * uint64_t(attribute.components);
  const AttributeRun& last = attribute.runs[attribute.run_count - 1];
  return last.first_value + (last.end_vertex - last.first_vertex) * uint64_t(attribute.components);
}

// Arrays are owned by the backend and live as long as the run. An attribute pointer is null if no part has it.
struct MeshView {
  const Vec3d* positions = nullptr;        // shaded, world space
  const Vec3d* index_positions = nullptr;  // the same in index space
  int64_t grid_dims[3] = {0, 0, 0};        // voxels of the grid that index space is of
  const Vec3f* normals = nullptr;          // shaded, world space
  const Vec4f* tangents = nullptr;         // shaded, world space, w = handedness
  const Vec3f* velocities = nullptr;       // shaded, world units a second; null: nothing moves
  const Vec2f* uv[2] = {nullptr, nullptr};
  const Vec4f* colors = nullptr;
  const AttributeView* attributes = nullptr;
  const uint32_t (*triangles)[3] = nullptr;
  const PartView* parts = nullptr;
  const MaterialView* materials = nullptr;
  const TextureView* textures = nullptr;
  uint64_t vertex_count = 0, triangle_count = 0;
  uint32_t part_count = 0, material_count = 0, texture_count = 0, attribute_count = 0;
};

// The part that a triangle belongs to, by binary search.
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
