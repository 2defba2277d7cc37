#include "mesh/weld.h"

#include <tbb/parallel_sort.h>

#include <numeric>

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

WeldedVertices Weld(const std::vector<Vec3d>& positions) {
  std::vector<uint32_t> order(positions.size());
  std::iota(order.begin(), order.end(), 0u);
  tbb::parallel_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return Before(positions[a], positions[b]); });
  WeldedVertices welded;
  welded.id.resize(positions.size());
  for (size_t i = 0; i < order.size(); ++i) {
    welded.count += i == 0 || Before(positions[order[i - 1]], positions[order[i]]);
    welded.id[order[i]] = uint32_t(welded.count - 1);
  }
  return welded;
}

}  // namespace voxelpipe
