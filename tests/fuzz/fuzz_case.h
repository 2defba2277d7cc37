// A small mesh and a request, made from a fuzzer's bytes.
#pragma once

#include <cstdint>
#include <span>

#include "job/request.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::fuzz {

// Every case is valid: the pipeline has no reason to refuse it. At most some 70 triangles and 22,000 voxels, so that
// slow references are affordable.
struct FuzzCase {
  TriangleMesh mesh;
  VoxelizeRequest request;
};

FuzzCase MakeCase(std::span<const uint8_t> bytes);

}  // namespace voxelpipe::fuzz
