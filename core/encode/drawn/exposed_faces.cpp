#include "encode/drawn/exposed_faces.h"

#include <tbb/parallel_for.h>

#include <vector>

namespace voxelpipe {

uint64_t CountFaces(const PreviewVolume& volume) {
  std::vector<uint64_t> layers(size_t(volume.dims()[2]));
  tbb::parallel_for(int64_t{0}, volume.dims()[2], [&](int64_t k) {
    VisitFaces(volume, k, [&](int64_t, int64_t, uint64_t, int) { ++layers[size_t(k)]; });
  });
  uint64_t faces = 0;
  for (const uint64_t count : layers) faces += count;
  return faces;
}

}  // namespace voxelpipe
