#include "mesh/triangle_mesh.h"

#include <algorithm>

namespace voxelpipe {

bool HasMotions(const TriangleMesh& mesh) {
  return std::any_of(mesh.placed.begin(), mesh.placed.end(),
                     [](const PlacedEntry& placed) { return placed.motion.has_value(); });
}

void ReleaseCharges(TriangleMesh& mesh) {
  mesh.memory.reset();
  for (const std::shared_ptr<Image>& image : mesh.images) {
    if (image != nullptr) image->memory.reset();
  }
}

}  // namespace voxelpipe
