// Estimates from a file's text if loading it may take much longer than its size suggests.
#pragma once

#include <cstdint>
#include <span>

#include "load/loader.h"

namespace voxelpipe {

struct CostlyParts {
  bool compressed = false;  // geometry that must be decoded: Draco, meshopt
  bool instanced = false;   // a few bytes may stand for many copies of a mesh (EXT_mesh_gpu_instancing)
  bool images = false;      // images, which are decoded if a shader reads them
};

// In: the file, or its beginning, of which the first kCostlyPartsBytes are read. All are true if the text does not end
// in them, if they do not show the format or if names may contain escapes. A name counts wherever it occurs in the
// text. Validates nothing. O(kCostlyPartsBytes).
inline constexpr size_t kCostlyPartsBytes = 1 << 20;
CostlyParts FindCostlyParts(std::span<const uint8_t> beginning, MeshFormat format);

}  // namespace voxelpipe
