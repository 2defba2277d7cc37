// Fills of parts: the meshes and their cases.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// Assemblies of bodies that overlap, lie within each other, are open, masked, moved or turned inside out; nested boxes;
// rows that thousands of faces cross; parts of scattered triangles. Their names begin with "parts_". The same ones for
// the same seed. `quick`: those for a sanitizer alone.
std::vector<ParityMesh> PartMeshes(uint32_t seed, bool quick);

// Every scope, coverage, fill, kind and layout, in slabs and streamed; targets of owners, of all fragments and of both.
// `quick`: each kernel once or twice.
std::vector<ParityCase> PartCases(const ParityMesh& named, bool quick);

}  // namespace voxelpipe::gpu
