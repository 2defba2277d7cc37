// An application-specific vertex attribute: one that glTF does not define.
#pragma once

#include <string>
#include <vector>

#include "mesh/scene/attribute_run.h"

namespace voxelpipe {

// glTF: its name begins with an underscore. Values as floats: normalized integers divided by their maximum, other
// integers converted.
struct VertexAttribute {
  std::string name;
  int components = 1;         // 1-4
  std::vector<float> values;  // `components` a vertex
  // The vertices with values, as ascending disjoint runs, so that many attributes of few vertices each store only
  // these; the attribute is 0 in all others. Empty: all have values. A primitive's attributes never have runs.
  std::vector<AttributeRun> runs{};
};

}  // namespace voxelpipe
