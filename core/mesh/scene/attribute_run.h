// The position of the values of a vertex attribute that only some of a mesh's vertices have.
#pragma once

#include <cstdint>

namespace voxelpipe {

// The values of the vertices [first_vertex, end_vertex), one vertex after the other.
struct AttributeRun {
  uint64_t first_vertex = 0, end_vertex = 0;
  uint64_t first_value = 0;  // index into the attribute's values
};

}  // namespace voxelpipe
