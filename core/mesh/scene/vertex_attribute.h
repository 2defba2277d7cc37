// A vertex attribute of the file's own, beside those that glTF defines.
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
  // Which vertices have values, ascending and apart, so that many attributes of a few vertices each take no more than
  // these; in all others it is 0. Empty: all have. A primitive's attributes never have runs.
  std::vector<AttributeRun> runs{};
};

}  // namespace voxelpipe
