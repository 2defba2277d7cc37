// Bounds on what a stranger's file may make the loader do. One struct, documented defaults.
#pragma once

#include <cstdint>

namespace voxelpipe {

struct LoadLimits {
  uint64_t max_file_bytes = 2ull << 30;            // bytes of the input
  uint64_t max_json_bytes = 64ull << 20;           // bytes of the JSON part
  uint32_t max_json_depth = 128;                   // nesting of JSON arrays and objects
  uint64_t max_decoded_bytes = 4ull << 30;         // bytes of all decoded attribute and index data together
  uint64_t max_triangles = 50'000'000;             // after instancing
  uint64_t max_vertices = 150'000'000;             // after instancing
  uint32_t max_nodes = 1'000'000;                  // nodes in the file
  uint64_t max_instances = 10'000'000;             // mesh instances after instancing
  uint32_t max_node_depth = 256;                   // levels of the node hierarchy
  uint64_t max_image_pixels = 64ull << 20;         // texels of one image, checked before it is decoded
  uint64_t max_total_image_pixels = 256ull << 20;  // texels of all images of a request
};

}  // namespace voxelpipe
