// Bounds on what an untrusted file may make the loader do. One struct, documented defaults. The job's memory (MemoryOf
// in base/job_context.h) bounds what the loader allocates, whatever these limits are.
#pragma once

#include <cstdint>

namespace voxelpipe {

struct LoadLimits {
  uint64_t max_file_bytes = 2ull << 30;         // bytes of the input
  uint64_t max_json_bytes = 64ull << 20;        // bytes of the JSON part
  uint64_t max_json_tree_bytes = 768ull << 20;  // memory of the parsed tree of the parts that are read
  uint32_t max_json_depth = 128;                // nesting of JSON arrays and objects
  // Elements that a file may declare for each of its bytes (at least kMinElements in all) without bytes of their own:
  // faces and points of Draco streams, the densest of which take a tenth of a byte each, and accessors without data.
  uint64_t max_elements_per_byte = 64;
  uint64_t max_draco_values_per_byte =
      256;                                  // points x components of all attributes of a Draco stream, beyond a million
  uint64_t max_triangles = 50'000'000;      // after instancing
  uint64_t max_vertices = 150'000'000;      // after instancing
  uint32_t max_nodes = 1'000'000;           // nodes in the file
  uint64_t max_instances = 10'000'000;      // mesh instances after instancing
  uint32_t max_node_depth = 256;            // levels of the node hierarchy
  uint64_t max_image_pixels = 64ull << 20;  // texels of one image, checked before it is decoded
  uint64_t max_total_image_pixels = 256ull << 20;  // texels of all images of a request
  uint32_t max_image_edge = 65'535;                // texels, JPEG's own limit
};

}  // namespace voxelpipe
