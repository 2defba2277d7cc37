#include "load/base/flat_scene.h"

#include <utility>

#include "shaders/texture/srgb.h"

namespace voxelpipe {
namespace {

constexpr size_t kElementsAStep = 1 << 16;  // between two polls of the job

// True if it was not finite.
bool Clean(float& value) {
  if (IsFinite(value)) return false;
  value = 0;
  return true;
}

}  // namespace

float LinearOfSrgb(float value) {
  if (!(value > 0)) return 0;
  if (value >= 1) return 1;
  const double code = double(value) * 255;
  const auto below = static_cast<unsigned char>(code);
  const double low = SrgbToLinear(below), high = SrgbToLinear(static_cast<unsigned char>(below + 1));
  double part = code - below;
  constexpr double kOnACode = 1e-4;  // code / 255 is rounded to float
  if (part < kOnACode) part = 0;
  if (part > 1 - kOnACode) part = 1;
  return static_cast<float>(low + part * (high - low));
}

Vec4f LinearColor(const Vec4f& srgb) {
  const float alpha = srgb.w > 0 ? (srgb.w < 1 ? srgb.w : 1.0f) : 0.0f;
  return {LinearOfSrgb(srgb.x), LinearOfSrgb(srgb.y), LinearOfSrgb(srgb.z), alpha};
}

bool CleanNormals(const JobContext& job, std::vector<Vec3f>& normals) {
  bool any = false;
  for (size_t i = 0; i < normals.size(); ++i) {
    if (i % kElementsAStep == 0 && !job.Check().ok()) break;
    for (int axis = 0; axis < 3; ++axis) any = Clean(normals[i][axis]) || any;
  }
  return any;
}

bool CleanUv(const JobContext& job, std::vector<Vec2f>& uv) {
  bool any = false;
  for (size_t i = 0; i < uv.size(); ++i) {
    if (i % kElementsAStep == 0 && !job.Check().ok()) break;
    any = Clean(uv[i].x) || any;
    any = Clean(uv[i].y) || any;
  }
  return any;
}

absl::Status AddPosition(const Vec3d& position, LoadBudget& budget, Primitive& out) {
  const Vec3f rounded = ToFloat(position);
  if (absl::Status full = budget.MakeRoom(out.positions, 1, "vertices"); !full.ok()) return full;
  out.positions.push_back(rounded);
  std::vector<Vec3d>& doubles = out.double_positions;
  if (doubles.empty()) {
    if (position == Vec3d{rounded.x, rounded.y, rounded.z}) return absl::OkStatus();
    const size_t before = out.positions.size() - 1;
    if (absl::Status full = budget.MakeRoom(doubles, before + 1, "vertices"); !full.ok()) return full;
    for (size_t i = 0; i < before; ++i) {
      if (i % kElementsAStep == 0) {
        if (absl::Status over = budget.job().Check(); !over.ok()) return over;
      }
      const Vec3f& p = out.positions[i];
      doubles.push_back({p.x, p.y, p.z});
    }
  }
  if (absl::Status full = budget.MakeRoom(doubles, 1, "vertices"); !full.ok()) return full;
  doubles.push_back(position);
  return absl::OkStatus();
}

Scene OneMeshScene(std::vector<Primitive> primitives, WarningList warnings, LoadBudget& budget) {
  Scene scene;
  scene.nodes.emplace_back();
  scene.nodes[0].mesh = 0;
  scene.roots = {0};
  scene.meshes.push_back(Mesh{"", std::move(primitives)});
  scene.warnings = std::move(warnings);
  scene.memory = budget.Release();
  return scene;
}

}  // namespace voxelpipe
