// A vertex attribute of the file's own, beside those that glTF defines.
#pragma once

#include <string>
#include <vector>

namespace voxelpipe {

// glTF: its name begins with an underscore. Values as floats: normalized integers divided by their maximum, other
// integers converted.
struct VertexAttribute {
  std::string name;
  int components = 1;         // 1-4
  std::vector<float> values;  // `components` a vertex
};

}  // namespace voxelpipe
