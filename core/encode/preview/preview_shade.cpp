// Orthographic rays through the voxels, more of them where neighbouring pixels differ (T. Whitted, "An Improved
// Illumination Model for Shaded Display", CACM 1980); corner darkening of voxel faces (M. Lysenko, "Ambient occlusion
// for Minecraft-like worlds", 2013), and one shadow ray.
#include "encode/preview/preview_shade.h"

#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>
#include <vector>

#include "encode/preview/preview_ground.h"
#include "encode/preview/preview_scene.h"

namespace voxelpipe {
namespace {

constexpr int kBlock = 8;  // pixels a side of a block that shares light
constexpr uint64_t kNoFace = ~uint64_t{0};

uint64_t FaceOf(uint64_t voxel, int axis) {
  return 3 * voxel + uint64_t(axis);
}

// Light changes slowly: close samples of a block of pixels share their lighting.
struct SharedLight {
  bool valid = false;
  Vec3d point, normal;
  double ambient = 0;
  int sun_samples = 0;  // samples that still reuse `sun`
  double sun = 0;
  // Normals and colours of the last faces hit.
  struct Face {
    uint64_t face = kNoFace;
    bool shaped = false;
    Vec3d normal;
    bool coloured = false;
    Vec3f colour;
  };
  std::array<Face, 32> faces;
};

// Of a table of 32.
size_t SlotOf(uint64_t face) {
  return (face * 0x9e3779b97f4a7c15) >> 59;
}

class Shader {
 public:
  Shader(const PreviewScene& scene, const PreviewColours& colours, const PixelRect& rect, const JobContext* job)
      : scene_(scene), colours_(colours), ground_(scene, rect, job), cubic_(SmoothStep(2.5, 16, scene.pixels())) {}

  // True if rays through the pixel can meet voxels.
  bool MayHit(int px, int py) const { return scene_.NearestDepth(px, py) != PreviewScene::kNothing; }
  // True if a face of a voxel looks the same wherever a ray meets it within a pixel.
  bool PlainFaces() const { return scene_.pixels() <= kLinePixels; }
  Vec3f Ground(int px, int py) const { return ground_.At(px, py); }
  // Linear RGB of the ray at (x, y), in pixels, within pixel (px, py).
  Vec3f At(int px, int py, double x, double y, SharedLight& shared) const;

 private:
  static constexpr double kLinePixels = 6;  // larger voxels are drawn with lines between them

  Vec3d SmoothNormal(const std::array<int64_t, 3>& voxel, const Vec3d& face) const;
  double CornerLight(const PreviewHit& hit, int sign, const Vec3d& index_point) const;
  double GridLine(const PreviewHit& hit, const Vec3d& index_point) const;
  Vec3f Surface(const PreviewHit& hit, uint64_t voxel, const Vec3d& point, size_t jitter, SharedLight& shared) const;

  const PreviewScene& scene_;
  const PreviewColours& colours_;
  const PreviewGround ground_;
  const double cubic_;  // large voxels are drawn as cubes (1), small ones as a smooth surface (0)
};

Vec3d Shader::SmoothNormal(const std::array<int64_t, 3>& voxel, const Vec3d& face) const {
  constexpr int kReach = 3, kWidth = 2 * kReach + 1;
  // For each pattern of a row of seven: the number of set bits, and the sum of their offsets.
  static const auto table = [] {
    std::array<std::array<int8_t, 2>, 1 << kWidth> sums{};
    for (size_t pattern = 0; pattern < sums.size(); ++pattern) {
      for (int bit = 0; bit < kWidth; ++bit) {
        if (!(pattern >> bit & 1)) continue;
        sums[pattern][0] = int8_t(sums[pattern][0] + 1);
        sums[pattern][1] = int8_t(sums[pattern][1] + bit - kReach);
      }
    }
    return sums;
  }();
  int sum_x = 0, sum_y = 0, sum_z = 0;
  // From the empty voxel in front of the face, so that a sheet one voxel thick has a normal too.
  const int64_t x = voxel[0] + int64_t(face.x), y = voxel[1] + int64_t(face.y), z = voxel[2] + int64_t(face.z);
  for (int dz = -kReach; dz <= kReach; ++dz) {
    for (int dy = -kReach; dy <= kReach; ++dy) {
      const auto& row = table[scene_.cells().volume().Row(x - kReach, y + dy, z + dz, kWidth)];
      sum_x += row[1];
      sum_y += row[0] * dy;
      sum_z += row[0] * dz;
    }
  }
  const Vec3d& scale = scene_.scale();
  const Vec3d normal = Unit({-sum_x * scale.x, -sum_y * scale.y, -sum_z * scale.z});
  // Normals that point away from the viewer belong to the other side of a thin sheet.
  if ((sum_x == 0 && sum_y == 0 && sum_z == 0) || Dot(normal, scene_.frame().eye) < 0) return face;
  return normal;
}

double Shader::CornerLight(const PreviewHit& hit, int sign, const Vec3d& index_point) const {
  const int a = hit.axis, b = (a + 1) % 3, c = (a + 2) % 3;
  const auto solid = [&](int db, int dc) {
    std::array<int64_t, 3> v = hit.voxel;
    v[size_t(a)] += sign;
    v[size_t(b)] += db;
    v[size_t(c)] += dc;
    return scene_.cells().volume().Solid(v[0], v[1], v[2]) ? 1 : 0;
  };
  const double fb = std::clamp(index_point[b] - double(hit.voxel[size_t(b)]), 0.0, 1.0);
  const double fc = std::clamp(index_point[c] - double(hit.voxel[size_t(c)]), 0.0, 1.0);
  const std::array<int, 2> edge_b{solid(-1, 0), solid(1, 0)}, edge_c{solid(0, -1), solid(0, 1)};
  double light = 0;
  for (const int sb : {0, 1}) {
    for (const int sc : {0, 1}) {
      const int edges = edge_b[size_t(sb)] + edge_c[size_t(sc)];
      const int blocked = edges == 2 ? 3 : edges + solid(2 * sb - 1, 2 * sc - 1);
      light += (1 - 0.2 * blocked) * (sb > 0 ? fb : 1 - fb) * (sc > 0 ? fc : 1 - fc);
    }
  }
  return light;
}

// Thin lines between large voxels: the share of light that is left.
double Shader::GridLine(const PreviewHit& hit, const Vec3d& index_point) const {
  double edge = 1;
  for (const int a : {(hit.axis + 1) % 3, (hit.axis + 2) % 3}) {
    const double f = index_point[a] - std::floor(index_point[a]);
    edge = std::min(edge, std::min(f, 1 - f) * scene_.scale()[a] * scene_.pixels());
  }
  return 1 - 0.22 * SmoothStep(kLinePixels, 14, scene_.pixels()) * (1 - SmoothStep(0.4, 1.3, edge));
}

Vec3f Shader::Surface(const PreviewHit& hit, uint64_t voxel, const Vec3d& point, size_t jitter,
                      SharedLight& shared) const {
  const Vec3d &eye = scene_.frame().eye, &to_light = scene_.light();
  const int sign = eye[hit.axis] > 0 ? 1 : -1;
  Vec3d face;
  face[hit.axis] = sign;
  const Vec3d index_point = scene_.ToIndex(point);
  Vec3d smooth, normal;
  const std::optional<Vec3f> stored = colours_.has_normals() ? colours_.NormalAt(voxel) : std::nullopt;
  if (stored.has_value()) {
    // Two-sided: takes the side that faces the viewer.
    smooth = Vec3d{double(stored->x), double(stored->y), double(stored->z)};
    if (Dot(smooth, eye) < 0) smooth = smooth * -1.0;
    normal = smooth;
  } else {
    const uint64_t key = FaceOf(voxel, hit.axis);
    SharedLight::Face& known = shared.faces[SlotOf(key)];
    if (!known.shaped || known.face != key) known = {key, true, SmoothNormal(hit.voxel, face), false, {}};
    smooth = known.normal;
    normal = Unit(smooth * (1 - 0.75 * cubic_) + face * (0.12 + 0.75 * cubic_));
  }

  const double cell = scene_.cells().CellSize(0), radius = scene_.radius();
  const Vec3d apart = point - shared.point;
  if (!shared.valid || Dot(apart, apart) > std::max(4.0, cell * cell) || Dot(smooth, shared.normal) < 0.7) {
    shared.valid = true;
    shared.point = point;
    shared.normal = smooth;
    shared.sun_samples = 0;
    shared.ambient = scene_.Open(point, smooth, std::max(1.5, cell));
    // The ground takes light from what faces it closely.
    const double low = std::max(0.0, 0.4 - smooth.y) * scene_.ground_share();
    if (low > 0) shared.ambient *= 1 - 0.5 * low * std::exp(-4 * (point.y - scene_.floor_height()) / radius);
  }
  double ambient = 0.12 + 0.88 * shared.ambient;
  if (cubic_ > 0) ambient *= 1 - cubic_ + cubic_ * CornerLight(hit, sign, index_point);

  double direct = std::max(0.0, Dot(normal, to_light));
  if (direct > 0) {
    if (shared.sun_samples == 0) {
      const Vec3d start = point + face * 0.02 + smooth * 1.2;
      shared.sun = scene_.Trace(start, scene_.lights()[jitter], 4 * radius).hit ? 0.25 : 1;
      shared.sun_samples = 2;
    }
    --shared.sun_samples;
    direct *= shared.sun;
  }
  const double sky = 0.5 + 0.5 * normal.y;
  // To the power of 40, which is nothing off the highlight.
  const double mirrored = Dot(normal, Unit(to_light + eye));
  const double highlight = mirrored > 0.8 ? std::pow(mirrored, 40.0) : 0;
  // Depth cue: nearer points are lighter, over the depth of the solid box.
  double dim = 1 + 0.10 * std::clamp(Dot(point - scene_.centre(), eye) / radius, -1.0, 1.0);
  if (!PlainFaces()) dim *= GridLine(hit, index_point);

  const Vec3f albedo = colours_.At(voxel);
  static constexpr Vec3d kSun{1.22, 1.15, 1.02}, kSky{0.44, 0.52, 0.64}, kBounce{0.30, 0.28, 0.26};
  Vec3f colour;
  for (int c = 0; c < 3; ++c) {
    const double light = kSun[c] * direct + ambient * (kSky[c] * sky + kBounce[c] * (1 - sky));
    double value = (double(albedo[c]) * light + 0.07 * highlight * direct) * dim;
    value = value < 0.7 ? value : 0.7 + 0.3 * std::tanh((value - 0.7) / 0.3);  // a soft shoulder instead of clipping
    colour[c] = float(value);
  }
  return colour;
}

Vec3f Shader::At(int px, int py, double x, double y, SharedLight& shared) const {
  // Neighbouring pixels use different directions of the light, which dithers the edge of the shadow.
  static constexpr uint8_t kDither[4][4] = {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};
  const Vec3d& eye = scene_.frame().eye;
  const double back = scene_.NearestDepth(px, py) + 2;  // in the empty space before the nearest cell
  const Vec3d origin = scene_.PointAt(x, y) + eye * back;
  const PreviewHit hit = scene_.Trace(origin, eye * -1.0, back + 2 * scene_.radius());
  if (!hit.hit) return ground_.At(px, py);
  const uint64_t voxel = scene_.cells().volume().Linear(hit.voxel[0], hit.voxel[1], hit.voxel[2]);
  const uint64_t face = FaceOf(voxel, hit.axis);
  SharedLight::Face& met = shared.faces[SlotOf(face)];
  if (PlainFaces() && met.face == face && met.coloured) return met.colour;
  const Vec3f colour = Surface(hit, voxel, origin + eye * -hit.t, kDither[py % 4][px % 4], shared);
  if (met.face != face) met = {face, false, {}, false, {}};
  met.coloured = true;
  met.colour = colour;
  return colour;
}

// True if an eye sees the border between two colours.
bool Differ(const Vec3f& a, const Vec3f& b) {
  constexpr float kStep = 0.08f;  // of the display's range, where values are about square roots
  for (int c = 0; c < 3; ++c) {
    const float step = a[c] - b[c];
    if (step * step > 4 * kStep * kStep * std::max(a[c], b[c])) return true;
  }
  return false;
}

// Calls visit(x, y, shared) for the pixels of the rectangle, in parallel, block after block in a fixed order.
template <typename Visit>
absl::Status ForEachPixel(const PixelRect& rect, const JobContext* job, const Visit& visit) {
  std::atomic<bool> stopped{false};
  constexpr int kTile = 4;  // blocks a side of a task
  const auto draw = [&](const tbb::blocked_range2d<int>& tile) {
    if (job != nullptr && !job->Check().ok()) stopped = true;
    if (stopped) return;
    for (int row = tile.rows().begin(); row < tile.rows().end(); ++row) {
      for (int column = tile.cols().begin(); column < tile.cols().end(); ++column) {
        SharedLight shared;  // of one block, so that the picture does not depend on the split into tasks
        for (int pixel = 0; pixel < kBlock * kBlock; ++pixel) {
          // Squares of four pixels, one after the other.
          const int square = pixel / 4;
          const int x = column * kBlock + 2 * (square % (kBlock / 2)) + pixel % 2;
          const int y = row * kBlock + 2 * (square / (kBlock / 2)) + pixel / 2 % 2;
          if (x < rect.width && y < rect.height) visit(x, y, shared);
        }
      }
    }
  };
  const int columns = (rect.width + kBlock - 1) / kBlock, rows = (rect.height + kBlock - 1) / kBlock;
  tbb::parallel_for(tbb::blocked_range2d<int>(0, rows, kTile, 0, columns, kTile), draw);
  return stopped ? job->Check() : absl::OkStatus();
}

void DrawAxes(const ViewFrame& frame, const PixelRect& rect, Canvas& canvas) {
  const double length = 0.055 * std::min(rect.width, rect.height);
  const double x = rect.x + 1.7 * length, y = rect.y + rect.height - 1.7 * length;
  const int dot = std::max(1, int(length / 26));
  constexpr std::array<std::string_view, 3> kNames = {"x", "y", "z"};
  std::array<int, 3> order{0, 1, 2};  // from the farthest end to the nearest
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return frame.eye[a] < frame.eye[b]; });
  for (const int a : order) {
    const double dx = frame.right[a] * length, dy = -frame.up[a] * length;
    if (std::hypot(dx, dy) < 0.1 * length) continue;  // along the view: a letter would cover the others
    canvas.Line(x, y, x + dx, y + dy, std::max(1.5, length / 16), AxisColour(a));
    canvas.Text(int(x + 1.3 * dx - 2.5 * dot), int(y + 1.3 * dy - 3.5 * dot), dot, kNames[size_t(a)], AxisColour(a));
  }
}

}  // namespace

absl::Status DrawView(const PreviewCells& cells, const PreviewColours& colours, const GridSpec& grid,
                      const PreviewView& view, const PixelRect& rect, int samples, const JobContext* job,
                      Canvas& canvas) {
  const uint64_t pixels = uint64_t(rect.width) * uint64_t(rect.height);
  MemoryCharge memory(&MemoryOf(job));
  // The first pass, and the depths of tiles.
  if (absl::Status s = memory.Grow(pixels, sizeof(Vec3f) + 1, "a view:"); !s.ok()) return s;
  if (absl::Status s = memory.Grow(PreviewGround::MemoryBytes(rect), "the ground of a view:"); !s.ok()) return s;
  const PreviewScene scene(cells, grid, view, rect, job);
  const Shader shader(scene, colours, rect, job);
  const auto at = [&rect](int x, int y) { return size_t(y) * size_t(rect.width) + size_t(x); };
  // The rays of a pixel are those of a lattice; the first pass takes one of them.
  std::vector<Vec3f> first(pixels);
  const auto ray = [&](int px, int py, int s, SharedLight& shared) {
    return shader.At(px, py, px + (s % samples + 0.5) / samples, py + (s / samples + 0.5) / samples, shared);
  };
  absl::Status status = ForEachPixel(rect, job, [&](int x, int y, SharedLight& shared) {
    const int px = rect.x + x, py = rect.y + y;
    const Vec3f colour = shader.MayHit(px, py) ? ray(px, py, 0, shared) : shader.Ground(px, py);
    canvas.At(px, py) = first[at(x, y)] = colour;
  });
  if (!status.ok()) return status;
  if (samples > 1) {
    const auto differs = [&](int x, int y) {
      const Vec3f& own = first[at(x, y)];
      return (x > 0 && Differ(own, first[at(x - 1, y)])) || (y > 0 && Differ(own, first[at(x, y - 1)])) ||
             (x + 1 < rect.width && Differ(own, first[at(x + 1, y)])) ||
             (y + 1 < rect.height && Differ(own, first[at(x, y + 1)]));
    };
    status = ForEachPixel(rect, job, [&](int x, int y, SharedLight& shared) {
      const int px = rect.x + x, py = rect.y + y;
      if (!shader.MayHit(px, py) || !differs(x, y)) return;
      Vec3f sum = first[at(x, y)];
      for (int s = 1; s < samples * samples; ++s) sum = sum + ray(px, py, s, shared);
      canvas.At(px, py) = sum * (1.0f / float(samples * samples));
    });
    if (!status.ok()) return status;
  }
  DrawAxes(scene.frame(), rect, canvas);
  return absl::OkStatus();
}

}  // namespace voxelpipe
