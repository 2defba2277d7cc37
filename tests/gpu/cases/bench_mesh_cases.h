// Parity cases on the meshes of the benchmark.
#pragma once

#include <string>
#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

// Of a mesh of the benchmark (bench_meshes.h): bits of both coverages at its larger resolutions; at 512^3 also values
// and the A-buffer, at 1024^3 blends of the scattered one.
std::vector<ParityCase> BenchMeshCases(const std::string& mesh);

}  // namespace voxelpipe::gpu
