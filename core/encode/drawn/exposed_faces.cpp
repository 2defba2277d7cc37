#include "encode/drawn/exposed_faces.h"

#include <limits>

namespace voxelpipe {

absl::StatusOr<FaceCount> CountFaces(const PreviewVolume& volume, const JobContext* job) {
  return SumOfLayers<FaceCount>(volume, job, [&](int64_t k, JobPoll& poll, FaceCount& sum) {
    uint64_t last = std::numeric_limits<uint64_t>::max();
    return VisitFaces(volume, k, poll, [&](int64_t, int64_t, uint64_t n, int) {
      ++sum.faces;
      sum.voxels += std::exchange(last, n) != n ? 1 : 0;
    });
  });
}

}  // namespace voxelpipe
