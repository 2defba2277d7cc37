// The facts of a mesh's health by the names under which every report of them gives them.
#pragma once

#include <string>

#include "mesh/health/fill_advice.h"
#include "mesh/health/health.h"

namespace voxelpipe {

// Calls put(name, value) for each, in the order of a report: counts, truth values, the volume, and as texts the fill
// that suits the mesh and why.
template <typename Put>
void ForEachHealthFact(const MeshHealth& health, const Put& put) {
  const FillAdvice advice = AdviseFill(health);
  put("watertight", health.watertight);
  put("edges", health.edges.edges);
  put("open_edges", health.edges.open);
  put("non_manifold_edges", health.edges.non_manifold);
  put("inconsistent_edges", health.edges.inconsistent);
  put("degenerate_triangles", health.degenerate_triangles);
  put("duplicate_triangles", health.duplicate_triangles);
  put("duplicate_vertices", health.duplicate_vertices);
  put("not_finite_vertices", health.not_finite_vertices);
  put("shells", health.shells);
  put("closed_shells", health.closed_shells);
  put("flipped_shells", health.flipped_shells);
  put("nested_shells", health.overlaps.nested);
  put("cavities", health.overlaps.cavities);
  put("overlapping_shells", health.overlaps.overlapping);
  put("shells_whose_boxes_overlap", health.overlaps.boxes_only);
  put("undecided_shells", health.overlaps.undecided);
  put("volume", health.volume);
  put("fill", std::string(Name(advice.fill)));
  put("why", advice.why);
}

}  // namespace voxelpipe
