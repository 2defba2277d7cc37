// Box and volume of shells.
#pragma once

#include "mesh/health/edges.h"

namespace voxelpipe {

// Sets the box of each shell, and the signed volume of those that are closed and oriented: a sixth of the sum of
// (a - r) . ((b - r) x (c - r)) over its triangles, in their order, r the first corner of the shell. O(triangles).
// Errors: the job's.
absl::Status MeasureShells(const JobContext& job, const TriangleMesh& mesh, ShellList& list);

// True if the volume is negative beyond rounding: below -1e-9 of that of the shell's box.
bool IsFlipped(const Shell& shell);

}  // namespace voxelpipe
