// Estimates from a file's text if loading it may take much longer than its size suggests.
#pragma once

#include <cstdint>
#include <span>

#include "load/loader.h"

namespace voxelpipe {

struct CostlyParts {
  bool compressed = false;  // geometry that a decoder makes: Draco, meshopt
  bool instanced = false;   // many copies of a mesh by a few bytes (EXT_mesh_gpu_instancing)
  bool images = false;      // that a decoder makes, where they are read
};

// In: the file, or its beginning. Where the text does not end in it, or names may be written with escapes, all are
// true. A name that only occurs somewhere in the text counts, too. Nothing is checked.
CostlyParts FindCostlyParts(std::span<const uint8_t> beginning, MeshFormat format);

}  // namespace voxelpipe
