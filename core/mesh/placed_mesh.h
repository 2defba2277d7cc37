// Several meshes on one grid: each is placed by a matrix, and together they are one flattened mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

inline constexpr size_t kMaxPlacedMeshes = 65'535;

// One mesh of a request for several.
struct PlacedMesh {
  std::shared_ptr<const TriangleMesh> mesh;  // not null; the same one may be placed many times
  // p' = M p in double. Row-major, 16 finite numbers, the last row 0 0 0 1, not singular. Where its determinant is
  // negative, corners 1 and 2 of every triangle change places.
  Mat4d matrix{};
  std::string name{};                          // what users call it; need not be unique
  std::optional<uint32_t> label{};             // at least 1; absent: its number in the list, from 1
  int32_t priority = 0;                        // of the parts that it has
  std::optional<RigidMotionNumbers> motion{};  // of its triangles, after placing; absent: it does not move
  // CountOpenEdges (report.h) of `mesh`, where the caller knows it: a frame of kept meshes then counts no edges.
  std::optional<uint64_t> open_edges{};
};

// INVALID_ARGUMENT if a matrix is not as PlacedMesh says, naming the number that is wrong.
absl::Status CheckPlacement(const Mat4d& matrix);

// In: 1 to kMaxPlacedMeshes meshes. Out: one mesh that holds all of them, in the order of the list. Triangle, vertex,
// mesh, node, material, texture and animation numbers run on from one mesh to the next; the default material comes
// after the last of all. Positions are M p, normals and tangents M's of the mesh's own, as a node's transform makes
// them (mesh/flatten.h); exactly the identity changes nothing. `placed` holds the rest of each entry, with its default
// label. A rig is there if every mesh has one; each follows its matrix. Images are shared with the meshes. Charged to
// the job's memory. Errors: INVALID_ARGUMENT naming the entry for no mesh, more than kMaxPlacedMeshes, a label of 0,
// and CheckPlacement's; RESOURCE_EXHAUSTED if triangles or vertices exceed `limits`; the job's.
absl::StatusOr<TriangleMesh> PlaceMeshes(const JobContext& job, std::span<const PlacedMesh> meshes,
                                         const LoadLimits& limits = {});

}  // namespace voxelpipe
