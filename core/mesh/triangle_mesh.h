// The flattened scene: one indexed triangle list in world space, the input of the pipeline.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/vec.h"
#include "base/warning.h"
#include "mesh/scene/material.h"
#include "mesh/scene/rig.h"
#include "mesh/scene/vertex_attribute.h"

namespace voxelpipe {

// A run of triangles that came from one primitive of one node instance.
struct MeshPart {
  uint64_t first_triangle = 0, triangle_count = 0;
  uint64_t first_vertex = 0, vertex_count = 0;
  int32_t material = -1;   // index into TriangleMesh::materials, -1 = default material
  uint32_t mesh = 0;       // glTF mesh index
  uint32_t node = 0;       // glTF node index
  uint32_t primitive = 0;  // index within the mesh
  bool has_normals = false, has_tangents = false, has_colors = false;
  bool has_uv[2] = {false, false};
};

// The names of a file's nodes and meshes, shared by copies of the flattened mesh. A node without a name has that of its
// nearest ancestor with one.
struct SceneNames {
  std::vector<std::string> nodes;
  std::vector<uint32_t> named_by;  // of each node, the index in `nodes` of its name
  std::vector<std::string> meshes;
};

// A rigid body's motion, world axes: v = linear + angular x (p - center).
struct RigidMotionNumbers {
  Vec3d linear;   // world units a second
  Vec3d angular;  // radians a second, right-handed
  Vec3d center;   // world units
  friend bool operator==(const RigidMotionNumbers&, const RigidMotionNumbers&) = default;
};

// One mesh of several that were placed together (placed_mesh.h).
struct PlacedEntry {
  uint64_t first_part = 0;  // its parts end where those of the next entry begin
  std::string name;
  uint32_t label = 1;
  int32_t priority = 0;
  std::optional<RigidMotionNumbers> motion;
  // Its names, and the ids of its first node and mesh here.
  std::shared_ptr<const SceneNames> names;
  uint32_t first_node = 0, first_mesh = 0;
  std::optional<uint64_t> open_edges;  // of the mesh alone, where that is known
};

// Structure of arrays. Triangle ids count from 0 over the flattened scene: default scene, depth first, node, instance,
// primitive, strip order; degenerate triangles keep theirs. World axes are the file's own (glTF: +Y up, metres,
// right-handed). An attribute array is empty if no part has the attribute, otherwise it has positions.size() elements
// and holds the default (normal 0, tangent 0, uv 0, colour 1) for parts without it.
struct TriangleMesh {
  std::vector<Vec3d> positions;  // world space, skinned and instanced
  std::vector<Vec3f> normals;    // world space, unit length (0 where the source is 0)
  std::vector<Vec4f> tangents;   // xyz world space unit length, w = handedness
  std::vector<Vec2f> uv[2];
  std::vector<Vec4f> colors;  // linear
  // Each name once, in the order of the parts, with the components of the widest part. In narrower parts missing
  // components are 0, the fourth 1; in parts without the attribute, which have no values (VertexAttribute::runs), all
  // are 0.
  std::vector<VertexAttribute> attributes;
  std::vector<std::array<uint32_t, 3>> triangles;
  // Ids of the vertices that no triangle uses, ascending. Absent if not known; the box is then computed over triangles.
  std::optional<std::vector<uint32_t>> unused_vertices;
  std::vector<MeshPart> parts;      // ascending, covering all triangles and all vertices exactly once
  std::vector<PlacedEntry> placed;  // empty: one mesh, as its file has it
  // The number of meshes and nodes of the file, drawn or not. Where it is too small, the largest id in `parts` decides.
  uint32_t mesh_count = 0, node_count = 0;
  std::shared_ptr<const SceneNames> names;  // null: not known, or those of `placed`
  bool parts_left_out = false;              // ExcludeParts has made it
  std::vector<Material> materials;
  std::vector<Texture> textures;
  std::vector<std::shared_ptr<Image>> images;  // shared with the Scene; decoded by PrepareTextures
  std::shared_ptr<const Rig> rig;              // null where the file has neither animations nor morph targets
  // Identifies the contents, for caches of meshes: two meshes with the same id have the same arrays, so that a device
  // copy of one serves the other. Empty: no known equal. A change to an array must change or clear the id.
  std::string content_id{};
  // Warnings of loading and flattening: every use of the mesh reports them again. Those of textures are stored with
  // images and materials.
  WarningList warnings{};
  // The charge for all but the images to the budget of the request that made it; null: not charged. Copies share it.
  std::shared_ptr<MemoryCharge> memory{};
};

// True if a placed mesh has a motion of its own.
bool HasMotions(const TriangleMesh& mesh);

// Releases the charges of the mesh and its images to a request's budget, for a caller that keeps the mesh longer than
// the request and counts it itself.
void ReleaseCharges(TriangleMesh& mesh);

}  // namespace voxelpipe
