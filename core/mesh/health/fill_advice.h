// The fill that suits a mesh.
#pragma once

#include <string>

#include "job/request.h"
#include "mesh/health/health.h"

namespace voxelpipe {

struct FillAdvice {
  Fill fill = Fill::kNone;
  std::string why;  // one clause
};

// In: the health of a mesh. Out:
//   none     without triangles
//   flood    with open edges, where parity and nonzero leave columns out: it works as long as no hole is wider than a
//            voxel; and for closed shells that overlap without a common orientation
//   nonzero  closed, oriented, and shells overlap or may, or edges or triangles are used several times
//   parity   all others: closed, and no shell meets another, whatever their orientation
FillAdvice AdviseFill(const MeshHealth& health);

}  // namespace voxelpipe
