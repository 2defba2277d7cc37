// Parts that the parsers of plain mesh formats share: colours, checks, and a scene of one mesh.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/vec.h"
#include "load/base/load_budget.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// The linear value of an sRGB one in [0, 1], others clamped, NaN 0: the table of shaders/texture/srgb.h, between its
// codes linearly. Exact for codes / 255.
float LinearOfSrgb(float value);
// Of red, green, blue and alpha in [0, 1]; alpha is linear already.
Vec4f LinearColor(const Vec4f& srgb);

inline bool IsFinite(float value) {
  return value - value == 0;
}
inline bool IsFinite(const Vec3f& p) {
  return IsFinite(p.x) && IsFinite(p.y) && IsFinite(p.z);
}
// The nearest floats; infinite beyond their range.
inline Vec3f ToFloat(const Vec3d& p) {
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

// Values that are not finite become 0; true if there were any. The job is polled; they stop early once it is over.
bool CleanNormals(const JobContext& job, std::vector<Vec3f>& normals);
bool CleanUv(const JobContext& job, std::vector<Vec2f>& uv);

// Adds a vertex, with its position in double where a float cannot hold that. In: a position whose floats are finite.
// Errors: RESOURCE_EXHAUSTED; the job's.
absl::Status AddPosition(const Vec3d& position, LoadBudget& budget, Primitive& out);

// A scene of one node and one mesh with these primitives; takes the budget's charge.
Scene OneMeshScene(std::vector<Primitive> primitives, WarningList warnings, LoadBudget& budget);

}  // namespace voxelpipe
