// Requests that run in this process, without Python: one, many in batches of the core, and their plans.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/result.h"
#include "mesh/report.h"
#include "mesh_source.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/request.h"

namespace voxelpipe {

// A result, and what its summary says of the mesh.
struct Outcome {
  VoxelizeResult result;
  MeshReport report;
  bool examined = false;  // degenerate triangles and open edges were counted
  std::vector<std::pair<std::string, double>> mesh_stages;
  uint64_t peak_bytes = 0;
};

// A mesh file that is to stay loaded, and its name.
struct NamedFile {
  std::span<const uint8_t> file;
  MeshFileType type;
  std::string name;
};

// Loads the files side by side. In: a job each. Out: a mesh each, in their order; errors: those of HeldMesh::Load.
std::vector<absl::StatusOr<std::shared_ptr<HeldMesh>>> LoadAll(std::span<const NamedFile> files,
                                                               std::span<JobContext* const> jobs);

// Errors: those of UsedMesh and of Voxelize. `on_device`: also FAILED_PRECONDITION if the result cannot stay on a GPU.
absl::StatusOr<Outcome> RunOne(const ParsedConfig& config, const MeshSource& source, const JobContext& job,
                               bool on_device);

// The same request of many meshes: loaded side by side, run as batches of the core. In: a job each. Out: an outcome
// each, in the order of the sources.
std::vector<absl::StatusOr<Outcome>> RunMany(const ParsedConfig& config, std::span<const MeshSource> sources,
                                             std::span<JobContext* const> jobs);

// Errors: those of RunOne before it rasterizes.
absl::StatusOr<v1::EstimateVoxelizationResponse> EstimateOne(const ParsedConfig& config, const MeshSource& source,
                                                             const JobContext& job);

}  // namespace voxelpipe
