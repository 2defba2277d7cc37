// The loaded scene: the contents of a mesh file, validated, before it is flattened to triangles.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "base/memory_budget.h"
#include "base/vec.h"
#include "base/warning.h"
#include "mesh/scene/animation.h"
#include "mesh/scene/material.h"
#include "mesh/scene/trs.h"
#include "mesh/scene/vertex_attribute.h"

namespace voxelpipe {

// Displacements of one morph target, object space; an array is empty where the target does not move that attribute.
struct MorphTarget {
  std::vector<Vec3f> positions, normals, tangents;
  // Why the target cannot be used: the file is wrong in it, but loads because its default weight is 0.
  absl::Status fault;
};

// A primitive before its morph targets: the attributes as stored, and the targets.
struct MorphData {
  std::vector<Vec3f> positions, normals;
  std::vector<Vec4f> tangents;
  std::vector<MorphTarget> targets;
};

// One drawable list of triangles of a mesh. Strips and fans are already expanded to lists in strip order, and every
// index is proved to be below positions.size(). Each attribute array is empty or has positions.size() elements.
struct Primitive {
  std::vector<Vec3f> positions;  // object space, morph targets at their default weights already applied
  // The positions as the file has them in double; empty where it has floats, or only values that floats hold. Never
  // with morph targets or joints.
  std::vector<Vec3d> double_positions;
  std::vector<Vec3f> normals;                      // object space, as stored (not normalized)
  std::vector<Vec4f> tangents;                     // xyz object space, w = handedness
  std::vector<Vec2f> uv[2];                        // TEXCOORD_0, TEXCOORD_1; origin top-left
  std::vector<Vec4f> colors;                       // COLOR_0, linear, alpha 1 where the file has RGB
  std::vector<std::array<uint16_t, 4>> joints[2];  // JOINTS_0, JOINTS_1
  std::vector<std::array<float, 4>> weights[2];    // WEIGHTS_0, WEIGHTS_1
  std::vector<VertexAttribute> attributes;         // application-specific, each name once
  std::shared_ptr<const MorphData> morph;          // null without morph targets
  std::vector<std::array<uint32_t, 3>> triangles;
  int32_t material = -1;         // index into Scene::materials, -1 = glTF's default material
  bool points_or_lines = false;  // drawn as points or lines: no triangles
};

// The position of a vertex, in double where the file has it so.
inline Vec3d PositionOf(const Primitive& primitive, size_t vertex) {
  if (!primitive.double_positions.empty()) return primitive.double_positions[vertex];
  const Vec3f& p = primitive.positions[vertex];
  return {p.x, p.y, p.z};
}

// Bytes of the arrays of morph data; of the arrays of a primitive, its morph data included.
uint64_t MorphBytes(const MorphData& morph);
uint64_t PrimitiveBytes(const Primitive& primitive);

struct Mesh {
  std::string name;
  std::vector<Primitive> primitives;
  std::vector<double> weights{};  // default weights of the morph targets, already applied to the primitives' positions
};

struct Skin {
  std::vector<uint32_t> joints;              // node indices
  std::vector<Mat4d> inverse_bind_matrices;  // as many as joints
};

struct Node {
  std::string name;
  Mat4d local;              // local transform, from matrix or TRS
  Trs trs;                  // the components of `local`, unless has_matrix
  bool has_matrix = false;  // then no animation may target the node's transform
  std::vector<uint32_t>
      children;  // node indices; the loader proved a forest (no cycles, one parent each, bounded depth)
  int32_t mesh = -1;
  int32_t skin = -1;
  std::vector<Mat4d> instances;  // EXT_mesh_gpu_instancing; empty = one instance, the node itself
  // Morph weights differ per node, so the loader gives a node with its own `weights` its own Mesh.
};

// Owns everything; nothing points into the bytes that were loaded.
struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Node> nodes;
  std::vector<Skin> skins;
  std::vector<Animation> animations;
  std::vector<Material> materials;
  std::vector<Texture> textures;
  std::vector<std::shared_ptr<Image>> images;
  std::vector<uint32_t> roots;  // root nodes of the scene to be flattened, in file order
  WarningList warnings;  // of the loader; those of images and texture references are stored with these (material.h)
  std::string format;    // "glb", "gltf", "drc", "stl", "ply", "off", "obj" or "3mf"
  std::string unit;      // of the file: "m" for glTF, "mm", ... ; that which the caller gave; empty: neither has one
  std::shared_ptr<MemoryCharge> memory{};  // charge for all but the images to the request's budget; null: not charged
};

}  // namespace voxelpipe
