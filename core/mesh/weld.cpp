#include "mesh/weld.h"

#include "base/long_loops.h"

namespace voxelpipe {
namespace {

// A strict weak order also where positions are NaN, which come last: a sort with any other order is undefined.
bool Less(double a, double b) {
  return a < b || (a == a && b != b);
}

bool Before(const Vec3d& a, const Vec3d& b) {
  for (int axis = 0; axis < 3; ++axis) {
    if (Less(a[axis], b[axis])) return true;
    if (Less(b[axis], a[axis])) return false;
  }
  return false;  // -0 == +0 in every comparison
}

}  // namespace

absl::StatusOr<WeldedVertices> Weld(const JobContext& job, const std::vector<Vec3d>& positions) {
  std::vector<uint32_t> order;
  order.reserve(positions.size());
  absl::Status over = InSteps(job, positions.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t i = begin; i < end; ++i) order.push_back(uint32_t(i));
  });
  if (!over.ok()) return over;
  over = ParallelSort(job, order, [&](uint32_t a, uint32_t b) { return Before(positions[a], positions[b]); });
  if (!over.ok()) return over;
  WeldedVertices welded;
  if (over = Resize(job, welded.id, order.size()); !over.ok()) return over;
  over = InSteps(job, order.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t i = begin; i < end; ++i) {
      welded.count += i == 0 || Before(positions[order[i - 1]], positions[order[i]]);
      welded.id[order[i]] = uint32_t(welded.count - 1);
    }
  });
  if (!over.ok()) return over;
  return welded;
}

}  // namespace voxelpipe
