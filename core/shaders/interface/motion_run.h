// The motions of several bodies in one mesh: each moves a run of its vertices.
#pragma once

#include <cstdint>

#include "shaders/interface/vertex.h"

namespace voxelpipe {

// The motion of the vertices from `first_vertex` to the next run.
struct MotionRun {
  uint64_t first_vertex = 0;
  double parameters[RigidMotion::kParameters] = {};
};

// Adds the velocity of the run that has vertex v, by binary search. In: runs by ascending first vertex, the first at 0.
VOXELPIPE_HD void AddMotion(const MotionRun* runs, uint32_t count, uint64_t v, ShadedVertex& vertex) {
  uint32_t lo = 0, hi = count;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (runs[mid].first_vertex <= v) {
      lo = mid;
    } else {
      hi = mid;
    }
  }
  RigidMotion::Add(runs[lo].parameters, vertex);
}

}  // namespace voxelpipe
