#include "encode/preview/preview_ground.h"

#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace voxelpipe {
namespace {

// The share of the light's directions that voxels block. Most points lie wholly in the light or in the shadow: four
// directions around the light tell, the others are for the border between the two.
double BlockedShare(const PreviewScene& scene, const Vec3d& point) {
  constexpr size_t kFirst = 4;
  const Vec3d start = point + Vec3d{0, 0.02, 0};
  size_t blocked = 0;
  for (size_t i = 0; i < PreviewScene::kLights; ++i) {
    if (i == kFirst && (blocked == 0 || blocked == kFirst)) return blocked == 0 ? 0 : 1;
    blocked += scene.Trace(start, scene.lights()[i], 8 * scene.radius()).hit ? 1 : 0;
  }
  return double(blocked) / double(PreviewScene::kLights);
}

// The share of the ground's light that the voxels take away.
double Shade(const PreviewScene& scene, const Vec3d& through) {
  const Vec3d& eye = scene.frame().eye;
  const Vec3d point = through + eye * ((scene.floor_height() - through.y) / eye.y);
  // Soft contact shadow: the density above the point, with more weight on near levels.
  const double open = scene.Open(point, {0, 1, 0}, std::max(1.5, scene.cells().CellSize(0)));
  const double lit = 1 - 0.45 * BlockedShare(scene, point);
  const Vec3d away = point - scene.centre();
  const double fade = 1 - SmoothStep(1.0, 2.4, std::hypot(away.x, away.z) / scene.radius());
  return std::clamp((1 - open * lit) * (0.25 + 0.75 * fade), 0.0, 1.0) * scene.ground_share();
}

Vec3f Node(const PreviewScene& scene, double x, double y) {
  static const Vec3f light_tone = FromSrgb(0xf3f5f7), shadow_tone = FromSrgb(0x6d7a8c);
  const Vec3d through = scene.PointAt(x, y);
  const double shade = scene.ground_share() > 0 ? Shade(scene, through) : 0;
  const Vec3d out = through - scene.centre();
  const double vignette = 1 - 0.10 * std::clamp(Dot(out, out) / (4 * scene.radius() * scene.radius()), 0.0, 1.0);
  return (light_tone + (shadow_tone - light_tone) * float(0.8 * shade)) * float(vignette);
}

// Pixels between two nodes.
int StepOf(const PixelRect& rect) {
  return std::max(1, std::min(rect.width, rect.height) / 160);
}

}  // namespace

uint64_t PreviewGround::MemoryBytes(const PixelRect& rect) {
  const int step = StepOf(rect);
  return uint64_t(rect.width / step + 2) * uint64_t(rect.height / step + 2) * sizeof(Vec3f);
}

PreviewGround::PreviewGround(const PreviewScene& scene, const PixelRect& rect, const JobContext* job) : rect_(rect) {
  const int step = StepOf(rect);
  inverse_step_ = 1 / float(step);
  columns_ = rect.width / step + 2;
  const int rows = rect.height / step + 2;
  nodes_.resize(size_t(columns_) * size_t(rows));
  tbb::parallel_for(tbb::blocked_range2d<int>(0, rows, 8, 0, columns_, 8), [&](const auto& tile) {
    if (!CheckJob(job).ok()) return;
    for (int y = tile.rows().begin(); y < tile.rows().end(); ++y) {
      for (int x = tile.cols().begin(); x < tile.cols().end(); ++x) {
        nodes_[size_t(y) * size_t(columns_) + size_t(x)] = Node(scene, rect.x + x * step, rect.y + y * step);
      }
    }
  });
}

}  // namespace voxelpipe
