#include "mesh/triangle_mesh.h"

namespace voxelpipe {

void ReleaseCharges(TriangleMesh& mesh) {
  mesh.memory.reset();
  for (const std::shared_ptr<Image>& image : mesh.images) {
    if (image != nullptr) image->memory.reset();
  }
}

}  // namespace voxelpipe
