// The option axes: which axes of the mesh those of the grid are.
#pragma once

#include <string_view>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "job/request.h"

namespace voxelpipe {

// In: a signed permutation such as "x,z,-y": the grid's x is the mesh's x, its y is the mesh's z, its z is the mesh's
// -y. Out: its matrix, row major, for column vectors. The determinant is -1 for permutations that mirror, such as
// "x,z,y". INVALID_ARGUMENT for anything else.
absl::StatusOr<Mat4d> ParseAxes(std::string_view text);

// In: a vertex shader, and the matrix of ParseAxes. Out: the call of `transform` that gives what the shader gives and
// then turns it: positions, normals, tangents and velocities, those of the rigid motion too. The call itself if the
// matrix is the identity. Errors: INVALID_ARGUMENT for a shader other than `identity` and `transform`, and for
// parameters that it does not take.
absl::StatusOr<ShaderCall> WithAxes(const ShaderCall& call, const Mat4d& axes);

}  // namespace voxelpipe
