// The contents of a mesh file besides its triangles, for reports.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

struct MeshContents {
  struct Attribute {
    std::string name;    // application-specific, with its underscore
    int components = 1;  // 1 to 4
  };
  std::string format;       // "glb", "gltf", "drc", "stl", "ply", "off", "obj", "3mf"
  std::string unit;         // that the positions had in the file, such as "mm"; empty: unknown, they are as in the file
  uint64_t file_bytes = 0;  // of the self-contained file
  uint64_t nodes = 0, meshes = 0;
  uint64_t parts = 0;  // primitives of node instances
  uint64_t materials = 0, textures = 0, images = 0;
  std::vector<Attribute> attributes;
};

// In: a scene, the mesh that it was flattened to, and the size of the file. May throw bad_alloc.
MeshContents ContentsOf(const Scene& scene, const TriangleMesh& mesh, uint64_t file_bytes);

}  // namespace voxelpipe
