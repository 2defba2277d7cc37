// Valid mesh files, one for each feature of the loader, for a fuzzer to corrupt.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "support/meshes/glb_builder.h"

namespace voxelpipe::fuzz {

struct Seed {
  std::string name;
  testing::GlbBuilder gltf;  // empty `drc`: what it writes
  std::vector<uint8_t> drc;  // a Draco file
  bool text = false;         // as .gltf rather than .glb
};

// Made once; the same in every process.
const std::vector<Seed>& Seeds();

// A mesh of some triangles as a Draco stream. Unique ids: 0 positions, 1 normals.
std::vector<uint8_t> DracoStream(bool sequential);

}  // namespace voxelpipe::fuzz
