// The meshes of cuda_parity, and the cases of each.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "gpu/cases/parity_cases.h"
#include "gpu/cases/parity_meshes.h"
#include "gpu/cases/parity_options.h"

namespace voxelpipe::gpu {

struct Subject {
  ParityMesh named;
  bool large = false, rigged = false;
  std::shared_ptr<const TriangleMesh> mesh;
  std::vector<ParityCase> cases;
};

// Of a mesh of ParityMeshes, which counts from 1. Null if `quick` omits the mesh.
std::optional<Subject> MakeSubject(const ParityMesh& named, uint32_t number, const ParityOptions& options);

}  // namespace voxelpipe::gpu
