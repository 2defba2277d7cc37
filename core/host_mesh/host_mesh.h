// The mesh of a run on the host, as the vertex shader leaves it: what all backends share.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "mesh/triangle_mesh.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/stages/stages.h"
#include "shaders/interface/motion_run.h"

namespace voxelpipe {

// Refers to the mesh, the request and the job, which must outlive it.
struct HostMesh {
  HostMesh(const TriangleMesh& m, const BoundRequest& r, const JobContext& j) : mesh(m), request(r), job(j) {}

  const TriangleMesh& mesh;
  const BoundRequest& request;
  const JobContext& job;

  std::vector<Vec3d> shaded_positions;  // empty under the identity shader, which uses the mesh's own
  std::vector<Vec3f> shaded_normals;
  std::vector<Vec4f> shaded_tangents;
  std::vector<Vec3f> velocities;                           // empty if nothing moves
  std::vector<std::array<uint32_t, 3>> ordered_triangles;  // by parts (order_parts.h); else empty
  MemoryCharge order_memory;                               // of that
  std::vector<MotionRun> motions;                          // of placed meshes; empty if none of them moves by itself
  std::vector<PartView> parts;
  std::vector<MaterialView> materials;
  std::vector<TextureView> textures;
  std::vector<AttributeView> attributes;
  MeshView view;  // what shaders read: of these arrays and of the mesh
};

// "node 3, mesh 1, primitive 0, vertex 17" for a vertex index of the flattened mesh.
std::string DescribeVertex(const TriangleMesh& mesh, uint64_t vertex);

}  // namespace voxelpipe
