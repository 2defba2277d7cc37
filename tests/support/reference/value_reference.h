// The values of results by their definitions: all fragments listed, shaded, converted and blended plainly and slowly.
//
// Coverage comes from raster/spans.h, and shader outputs from the shaders; both are tested elsewhere. Conversion,
// blending, bricks and buckets share no code with the product: numbers are rounded by searching the format's own values
// or by the C library, sums are kept in 128 bits.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "job/request.h"
#include "mesh/triangle_mesh.h"
#include "shaders/interface/fragment.h"

namespace voxelpipe::testing {

// In: a mesh in index space, the grid's dims. Out: for each voxel in linear order the triangles that touch it,
// ascending.
std::vector<std::vector<uint32_t>> FragmentLists(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims,
                                                 Coverage coverage);

// A number (clear, fill value) as stored in a format: the low 1, 8, 16 or 32 bits.
uint32_t ReferenceNumber(double v, VoxelFormat format);

// Component c of a voxel of a target, as stored: `fragments` are its shader's outputs by ascending triangle id, at
// least one.
uint32_t ReferenceBlend(const TargetSpec& spec, const std::vector<FragmentOutput>& fragments, int c);

// The arrays of the whole result in stream order (job/result.h). `inside`: for each voxel true if it is filled without
// a fragment; may be empty. The grid is UnitGrid(dims); vertex shader identity.
std::vector<std::vector<uint8_t>> ReferenceArrays(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                                  const std::vector<bool>& inside = {});

}  // namespace voxelpipe::testing
