// Valid mesh files, one for each feature of the loader, for a fuzzer to corrupt.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "support/meshes/glb_builder.h"

namespace voxelpipe::fuzz {

struct Seed {
  std::string name;
  testing::GlbBuilder gltf;   // empty `file`: what it writes
  std::vector<uint8_t> file;  // a file of another format
  bool text = false;          // as .gltf rather than .glb
};

// Made once; the same in every process.
const std::vector<Seed>& Seeds();

// Files of one format, small and with most of what it has.
std::vector<std::vector<uint8_t>> StlFiles();
std::vector<std::vector<uint8_t>> PlyFiles();
std::vector<std::vector<uint8_t>> OffFiles();
std::vector<std::vector<uint8_t>> ObjFiles();
std::vector<std::vector<uint8_t>> ThreemfFiles();

// A mesh of some triangles as a Draco stream. Unique ids: 0 positions, 1 normals.
std::vector<uint8_t> DracoStream(bool sequential);

}  // namespace voxelpipe::fuzz
