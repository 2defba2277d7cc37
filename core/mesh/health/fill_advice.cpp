#include "mesh/health/fill_advice.h"

namespace voxelpipe {

FillAdvice AdviseFill(const MeshHealth& health) {
  if (health.shells == 0) return {Fill::kNone, "no triangle has an area"};
  if (!health.watertight) return {Fill::kFlood, "the mesh has open edges; holes wider than a voxel stay open"};
  const bool meets = health.overlaps.any() || health.edges.non_manifold > 0 || health.duplicate_triangles > 0;
  if (!meets) return {Fill::kParity, health.shells == 1 ? "one closed shell" : "closed shells that do not overlap"};
  // A shell that faces inward cancels those that it overlaps; a cavity is meant to.
  const bool oriented = health.edges.inconsistent == 0 && health.flipped_shells == health.overlaps.cavities;
  if (oriented) return {Fill::kNonzero, "closed parts overlap or touch, and face outward"};
  return {Fill::kFlood, "closed parts overlap or touch, and do not all face outward; cavities are filled too"};
}

}  // namespace voxelpipe
