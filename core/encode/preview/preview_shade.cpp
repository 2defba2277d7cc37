// Orthographic rays through the voxels; ambient occlusion by a few cones through the density pyramid (C. Crassin et
// al., "Interactive Indirect Illumination Using Voxel Cone Tracing", Pacific Graphics 2011, reduced to occlusion),
// corner darkening of voxel faces (M. Lysenko, "Ambient occlusion for Minecraft-like worlds", 2013), and one shadow
// ray.
#include "encode/preview/preview_shade.h"

#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>
#include <vector>

namespace voxelpipe {
namespace {

constexpr double kAzimuth = 0.785398163397448;    // 45 degrees, from +Z towards +X
constexpr double kElevation = 0.615479708670387;  // atan(1/sqrt(2)): the three axes appear equally long

Vec3d Unit(const Vec3d& v) {
  const double length = std::sqrt(Dot(v, v));
  return length > 0 ? v * (1 / length) : v;
}

double SmoothStep(double low, double high, double value) {
  const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// "Scaled" space below is index space times the relative voxel size: square, +Y up.
class Shader {
 public:
  Shader(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid, const PixelRect& rect)
      : volume_(volume), colours_(colours), scale_(RelativeVoxelSize(grid)) {
    right_ = {std::cos(kAzimuth), 0, -std::sin(kAzimuth)};
    eye_ = {std::cos(kElevation) * std::sin(kAzimuth), std::sin(kElevation), std::cos(kElevation) * std::cos(kAzimuth)};
    up_ = Cross(eye_, right_);
    light_ = Unit(right_ * -0.55 + up_ * 0.75 + eye_ * 0.62);
    // 16 directions within a small disc around the light, whose mean is a soft shadow.
    for (size_t i = 0; i < lights_.size(); ++i) {
      const double angle = 2.399963229728653 * double(i);  // the golden angle
      const double spread = 0.07 * std::sqrt((double(i) + 0.5) / double(lights_.size()));
      lights_[i] = Unit(light_ + right_ * (spread * std::cos(angle)) + up_ * (spread * std::sin(angle)));
    }
    Fit(rect);
    FindDepths(rect);
    LightGround(rect);
  }

  // Light changes slowly: close samples of a block of pixels share their lighting.
  struct Shared {
    bool valid = false;
    Vec3d point;
    double ambient = 0;
    int sun_samples = 0;  // samples of this pixel that still reuse `sun`
    double sun = 0;
    // Normals of the last voxels hit, by voxel and axis of the face.
    struct Normal {
      uint64_t key = ~uint64_t{0};
      Vec3d value;
    };
    std::array<Normal, 8> normals;
  };

  // The mean of samples^2 rays through the pixel.
  Vec3f Pixel(int x, int y, int samples, Shared& shared) const;
  const Vec3d& right() const { return right_; }
  const Vec3d& up() const { return up_; }

 private:
  // The projection of a box, scaled and relative to centre_: its middle, half its extent, and its nearest depth.
  struct Shown {
    double x = 0, y = 0, across = 0, along = 0, near = 0;
  };
  Shown Show(const Vec3d& low, const Vec3d& high) const;

  void Fit(const PixelRect& rect);
  Vec3d ToIndex(const Vec3d& p) const { return {p.x / scale_.x, p.y / scale_.y, p.z / scale_.z}; }
  PreviewHit TraceScaled(const Vec3d& origin, const Vec3d& direction, double length) const {
    return volume_.Trace(ToIndex(origin), ToIndex(direction), 0, length);
  }
  Vec3d SmoothNormal(const std::array<int64_t, 3>& voxel, const Vec3d& face) const;
  double Occlusion(const Vec3d& point, const Vec3d& normal, double first_step) const;
  double CornerLight(const PreviewHit& hit, int sign, const Vec3d& index_point) const;
  Vec3f Surface(const PreviewHit& hit, const Vec3d& point, int jitter, Shared& shared) const;
  Vec3f Ground(double x, double y) const;
  void FindDepths(const PixelRect& rect);
  void LightGround(const PixelRect& rect);
  Vec3f GroundAt(int px, int py) const;

  const PreviewVolume& volume_;
  const PreviewColours& colours_;
  Vec3d scale_, right_, up_, eye_, light_;
  std::array<Vec3d, 16> lights_;
  Vec3d centre_;                        // scaled, of the solid box
  double radius_ = 1;                   // scaled, of the solid box
  double pixels_ = 1;                   // a unit of scaled space
  double middle_x_ = 0, middle_y_ = 0;  // centre_ in the picture, pixels
  static constexpr int kDepthTile = 4;  // pixels
  static constexpr double kNothing = -1e300;
  std::vector<double> depths_;  // along eye_ from centre_, scaled; depth_columns_ tiles a row
  int depth_x_ = 0, depth_y_ = 0, depth_columns_ = 0;
  std::vector<Vec3f> ground_;  // linear RGB at the nodes of the lattice, ground_columns_ a row
  int ground_x_ = 0, ground_y_ = 0, ground_step_ = 1, ground_columns_ = 0;  // pixels
};

Shader::Shown Shader::Show(const Vec3d& low, const Vec3d& high) const {
  Shown box;
  for (int a = 0; a < 3; ++a) {
    const double middle = (low[a] + high[a]) * 0.5 * scale_[a] - centre_[a];
    const double extent = (high[a] - low[a]) * 0.5 * scale_[a];
    box.x += right_[a] * middle;
    box.y += up_[a] * middle;
    box.across += std::abs(right_[a]) * extent;
    box.along += std::abs(up_[a]) * extent;
    box.near += eye_[a] * middle + std::abs(eye_[a]) * extent;
  }
  return box;
}

void Shader::Fit(const PixelRect& rect) {
  middle_x_ = rect.x + rect.width / 2.0;
  middle_y_ = rect.y + rect.height / 2.0;
  Vec3d low, high;
  for (int a = 0; a < 3; ++a) {
    low[a] = double(volume_.lo()[a]) * scale_[a];
    high[a] = double(volume_.hi()[a]) * scale_[a];
  }
  centre_ = (low + high) * 0.5;
  const Vec3d half = (high - low) * 0.5;
  radius_ = std::max(1.0, std::sqrt(Dot(half, half)));
  // The frame fits the solid voxels, not their box, which would leave half of an isometric picture empty.
  double left = 1e300, rightmost = -1e300, bottom = 1e300, top = -1e300;
  volume_.VisitCells([&](const Vec3d& cell_low, const Vec3d& cell_high) {
    const Shown cell = Show(cell_low, cell_high);
    left = std::min(left, cell.x - cell.across);
    rightmost = std::max(rightmost, cell.x + cell.across);
    bottom = std::min(bottom, cell.y - cell.along);
    top = std::max(top, cell.y + cell.along);
  });
  constexpr double kFilled = 0.8;  // of the rectangle
  pixels_ = kFilled * std::min(rect.width / (rightmost - left), rect.height / (top - bottom));
  middle_x_ -= pixels_ * (left + rightmost) / 2;
  middle_y_ += pixels_ * (bottom + top) / 2;
}

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
  Vec3d sum;
  // From the empty voxel in front of the face, so that a sheet one voxel thick has a normal too.
  const int64_t x = voxel[0] + int64_t(face.x), y = voxel[1] + int64_t(face.y), z = voxel[2] + int64_t(face.z);
  for (int dz = -kReach; dz <= kReach; ++dz) {
    for (int dy = -kReach; dy <= kReach; ++dy) {
      const auto& row = table[volume_.Row(x - kReach, y + dy, z + dz, kWidth)];
      sum = sum + Vec3d{double(row[1]), double(row[0] * dy), double(row[0] * dz)};
    }
  }
  const Vec3d normal = Unit({-sum.x * scale_.x, -sum.y * scale_.y, -sum.z * scale_.z});
  // Normals that point away from the viewer belong to the other side of a thin sheet.
  if (Dot(sum, sum) == 0 || Dot(normal, eye_) < 0) return face;
  return normal;
}

double Shader::Occlusion(const Vec3d& point, const Vec3d& normal, double first_step) const {
  const Vec3d side = Unit(Cross(normal, std::abs(normal.y) < 0.9 ? Vec3d{0, 1, 0} : Vec3d{1, 0, 0}));
  const Vec3d other = Cross(normal, side);
  const std::array<Vec3d, 5> cones = {normal, Unit(normal + side * 1.2), Unit(normal - side * 1.2),
                                      Unit(normal + other * 1.2), Unit(normal - other * 1.2)};
  double open = 0;
  for (const Vec3d& cone : cones) {
    double through = 1, distance = first_step;
    for (int level = 0; level < volume_.levels() && distance < radius_; ++level) {
      const double density = volume_.Density(level, ToIndex(point + cone * distance));
      through *= 1 - std::min(1.0, 1.3 * density) * (1 - distance / radius_);
      distance = std::max(distance * 1.8, 1.1 * volume_.CellSize(level + 1));
    }
    open += through;
  }
  return open / double(cones.size());
}

double Shader::CornerLight(const PreviewHit& hit, int sign, const Vec3d& index_point) const {
  const int a = hit.axis, b = (a + 1) % 3, c = (a + 2) % 3;
  const auto solid = [&](int db, int dc) {
    std::array<int64_t, 3> v = hit.voxel;
    v[size_t(a)] += sign;
    v[size_t(b)] += db;
    v[size_t(c)] += dc;
    return volume_.Solid(v[0], v[1], v[2]) ? 1 : 0;
  };
  const double fb = std::clamp(index_point[b] - double(hit.voxel[size_t(b)]), 0.0, 1.0);
  const double fc = std::clamp(index_point[c] - double(hit.voxel[size_t(c)]), 0.0, 1.0);
  double light = 0;
  for (const int sb : {-1, 1}) {
    for (const int sc : {-1, 1}) {
      const int edge_b = solid(sb, 0), edge_c = solid(0, sc);
      const int blocked = edge_b && edge_c ? 3 : edge_b + edge_c + solid(sb, sc);
      light += (1 - 0.2 * blocked) * (sb > 0 ? fb : 1 - fb) * (sc > 0 ? fc : 1 - fc);
    }
  }
  return light;
}

Vec3f Shader::Surface(const PreviewHit& hit, const Vec3d& point, int jitter, Shared& shared) const {
  const int sign = eye_[hit.axis] > 0 ? 1 : -1;
  Vec3d face;
  face[hit.axis] = sign;
  const Vec3d index_point = ToIndex(point);
  // Large voxels are drawn as cubes, small ones as a smooth surface.
  const double cubic = SmoothStep(2.5, 16, pixels_);
  const uint64_t voxel = volume_.Linear(hit.voxel[0], hit.voxel[1], hit.voxel[2]);
  Vec3d smooth, normal;
  if (const std::optional<Vec3f> stored = colours_.NormalAt(voxel); stored.has_value()) {
    // Two-sided: takes the side that faces the viewer.
    smooth = Vec3d{double(stored->x), double(stored->y), double(stored->z)};
    if (Dot(smooth, eye_) < 0) smooth = smooth * -1.0;
    normal = smooth;
  } else {
    const uint64_t key = 3 * voxel + uint64_t(hit.axis);
    Shared::Normal& known = shared.normals[(key * 0x9e3779b97f4a7c15) >> 61];
    if (known.key != key) known = {key, SmoothNormal(hit.voxel, face)};
    smooth = known.value;
    normal = Unit(smooth * (1 - 0.75 * cubic) + face * (0.12 + 0.75 * cubic));
  }

  const double cell = volume_.CellSize(0);
  const Vec3d apart = point - shared.point;
  if (!shared.valid || Dot(apart, apart) > 4) {
    shared.valid = true;
    shared.point = point;
    shared.sun_samples = 0;
    shared.ambient = Occlusion(point, smooth, std::max(1.5, cell));
    // The ground takes light from what faces it closely.
    const double height = (point.y - double(volume_.lo()[1]) * scale_.y) / radius_;
    shared.ambient *= 1 - 0.5 * std::max(0.0, 0.4 - smooth.y) * std::exp(-4 * height);
  }
  double ambient = 0.12 + 0.88 * shared.ambient;
  if (cubic > 0) ambient *= 1 - cubic + cubic * CornerLight(hit, sign, index_point);

  double direct = std::max(0.0, Dot(normal, light_));
  if (direct > 0) {
    if (shared.sun_samples == 0) {
      const Vec3d start = point + face * 0.02 + smooth * 1.2;
      shared.sun = TraceScaled(start, lights_[size_t(jitter) % lights_.size()], 4 * radius_).hit ? 0.25 : 1;
      shared.sun_samples = 2;
    }
    --shared.sun_samples;
    direct *= shared.sun;
  }
  const double sky = 0.5 + 0.5 * normal.y;
  const double highlight = std::pow(std::max(0.0, Dot(normal, Unit(light_ + eye_))), 40.0);
  // Depth cue: nearer points are lighter, over the depth of the solid box.
  const double depth = 1 + 0.10 * std::clamp(Dot(point - centre_, eye_) / radius_, -1.0, 1.0);

  double grid_line = 1;
  if (pixels_ > 6) {  // thin lines between large voxels
    double edge = 1;
    for (const int a : {(hit.axis + 1) % 3, (hit.axis + 2) % 3}) {
      const double f = index_point[a] - std::floor(index_point[a]);
      edge = std::min(edge, std::min(f, 1 - f) * scale_[a] * pixels_);
    }
    grid_line = 1 - 0.22 * SmoothStep(6, 14, pixels_) * (1 - SmoothStep(0.4, 1.3, edge));
  }

  const Vec3f albedo = colours_.At(voxel);
  static constexpr Vec3d kSun{1.22, 1.15, 1.02}, kSky{0.44, 0.52, 0.64}, kBounce{0.30, 0.28, 0.26};
  Vec3f colour;
  for (int c = 0; c < 3; ++c) {
    const double light = kSun[c] * direct + ambient * (kSky[c] * sky + kBounce[c] * (1 - sky));
    double value = (double(albedo[c]) * light + 0.07 * highlight * direct) * depth * grid_line;
    value = value < 0.7 ? value : 0.7 + 0.3 * std::tanh((value - 0.7) / 0.3);  // a soft shoulder instead of clipping
    colour[c] = float(value);
  }
  return colour;
}

Vec3f Shader::Ground(double x, double y) const {
  static const Vec3f light_tone = FromSrgb(0xf3f5f7), shadow_tone = FromSrgb(0x6d7a8c);
  const Vec3d through = centre_ + right_ * x + up_ * y;
  const double floor_height = double(volume_.lo()[1]) * scale_.y;
  const Vec3d point = through + eye_ * ((floor_height - through.y) / eye_.y);
  // Soft contact shadow: the density above the point, with more weight on near levels.
  const double first = std::max(1.5, volume_.CellSize(0));
  const double open = Occlusion(point, {0, 1, 0}, first);
  int blocked = 0;
  for (const Vec3d& light : lights_) {
    blocked += TraceScaled(point + Vec3d{0, 0.02, 0}, light, 8 * radius_).hit ? 1 : 0;
  }
  const double lit = 1 - 0.45 * blocked / double(lights_.size());
  const Vec3d away = point - centre_;
  const double fade = 1 - SmoothStep(1.0, 2.4, std::hypot(away.x, away.z) / radius_);
  const double shade = std::clamp((1 - open * lit) * (0.25 + 0.75 * fade), 0.0, 1.0);
  const double vignette = 1 - 0.10 * std::clamp((x * x + y * y) / (4 * radius_ * radius_), 0.0, 1.0);
  return (light_tone + (shadow_tone - light_tone) * float(0.8 * shade)) * float(vignette);
}

// For each tile of the picture the depth of its nearest cell with voxels, where its rays start.
void Shader::FindDepths(const PixelRect& rect) {
  depth_x_ = rect.x;
  depth_y_ = rect.y;
  depth_columns_ = rect.width / kDepthTile + 1;
  const int rows = rect.height / kDepthTile + 1;
  depths_.assign(size_t(depth_columns_) * size_t(rows), kNothing);
  volume_.VisitCells([&](const Vec3d& low, const Vec3d& high) {
    const Shown cell = Show(low, high);
    const auto tile = [](double pixel, int limit) {
      return std::clamp(int(std::floor(pixel / kDepthTile)), 0, limit - 1);
    };
    constexpr double kSlack = 0.01;  // pixels
    const double x = cell.x * pixels_ + middle_x_ - rect.x, across = cell.across * pixels_ + kSlack;
    const double y = middle_y_ - cell.y * pixels_ - rect.y, along = cell.along * pixels_ + kSlack;
    const int left = tile(x - across, depth_columns_), right = tile(x + across, depth_columns_);
    for (int row = tile(y - along, rows); row <= tile(y + along, rows); ++row) {
      for (int column = left; column <= right; ++column) {
        double& depth = depths_[size_t(row) * size_t(depth_columns_) + size_t(column)];
        depth = std::max(depth, cell.near);
      }
    }
  });
}

// The light on the ground is smooth: it is computed at the nodes of a coarse lattice and interpolated.
void Shader::LightGround(const PixelRect& rect) {
  ground_x_ = rect.x;
  ground_y_ = rect.y;
  ground_step_ = std::max(1, std::min(rect.width, rect.height) / 240);
  ground_columns_ = rect.width / ground_step_ + 2;
  const int rows = rect.height / ground_step_ + 2;
  ground_.resize(size_t(ground_columns_) * size_t(rows));
  tbb::parallel_for(tbb::blocked_range2d<int>(0, rows, 8, 0, ground_columns_, 8), [&](const auto& tile) {
    for (int y = tile.rows().begin(); y < tile.rows().end(); ++y) {
      for (int x = tile.cols().begin(); x < tile.cols().end(); ++x) {
        const double px = ground_x_ + x * ground_step_, py = ground_y_ + y * ground_step_;
        ground_[size_t(y) * size_t(ground_columns_) + size_t(x)] =
            Ground((px - middle_x_) / pixels_, (middle_y_ - py) / pixels_);
      }
    }
  });
}

// At the centre of the pixel.
Vec3f Shader::GroundAt(int px, int py) const {
  const float x = (float(px - ground_x_) + 0.5f) / float(ground_step_);
  const float y = (float(py - ground_y_) + 0.5f) / float(ground_step_);
  const int column = int(x), row = int(y);
  const Vec3f* node = &ground_[size_t(row) * size_t(ground_columns_) + size_t(column)];
  const Vec3f* below = node + ground_columns_;
  const float u = x - float(column), v = y - float(row);
  const Vec3f top = node[0] + (node[1] - node[0]) * u, bottom = below[0] + (below[1] - below[0]) * u;
  return top + (bottom - top) * v;
}

Vec3f Shader::Pixel(int px, int py, int samples, Shared& shared) const {
  const double near =
      depths_[size_t((py - depth_y_) / kDepthTile) * size_t(depth_columns_) + size_t((px - depth_x_) / kDepthTile)];
  if (near == kNothing) return GroundAt(px, py);
  const double back = near + 2;  // in the empty space before the nearest cell
  Vec3f sum;
  int missed = 0;
  shared.sun_samples = 0;
  for (int s = 0; s < samples * samples; ++s) {
    const double x = (px + (s % samples + 0.5) / samples - middle_x_) / pixels_;
    const double y = (middle_y_ - py - (s / samples + 0.5) / samples) / pixels_;
    const Vec3d origin = centre_ + right_ * x + up_ * y + eye_ * back;
    const PreviewHit hit = TraceScaled(origin, eye_ * -1.0, back + 2 * radius_);
    if (hit.hit) {
      // Neighbouring pixels use different directions of the light, which dithers the edge of the shadow.
      sum = sum + Surface(hit, origin + eye_ * -hit.t, 4 * (px % 2 + 2 * (py % 2)) + s, shared);
    } else {
      ++missed;
    }
  }
  if (missed > 0) sum = sum + GroundAt(px, py) * float(missed);
  return sum * (1.0f / float(samples * samples));
}

void DrawAxes(const Shader& shader, const PixelRect& rect, Canvas& canvas) {
  const double length = 0.055 * std::min(rect.width, rect.height);
  const double x = rect.x + 1.7 * length, y = rect.y + rect.height - 1.4 * length;
  const int dot = std::max(1, int(length / 26));
  static const std::array<Vec3f, 3> colours = {FromSrgb(0xc8414b), FromSrgb(0x3f9a4f), FromSrgb(0x3a6fd0)};
  constexpr std::array<std::string_view, 3> kNames = {"x", "y", "z"};
  for (const int a : {2, 0, 1}) {
    const double dx = shader.right()[a] * length, dy = -shader.up()[a] * length;
    canvas.Line(x, y, x + dx, y + dy, std::max(1.5, length / 16), colours[size_t(a)]);
    canvas.Text(int(x + 1.3 * dx - 2.5 * dot), int(y + 1.3 * dy - 3.5 * dot), dot, kNames[size_t(a)],
                colours[size_t(a)]);
  }
}

}  // namespace

Vec3d RelativeVoxelSize(const GridSpec& grid) {
  const Vec3d& h = grid.voxel_size;
  const double smallest = std::min({h.x, h.y, h.z});
  Vec3d relative;
  for (int a = 0; a < 3; ++a) relative[a] = std::clamp(h[a] / smallest, 1.0, 1000.0);
  return relative;
}

absl::Status DrawIsometric(const PreviewVolume& volume, const PreviewColours& colours, const GridSpec& grid,
                           const PixelRect& rect, int samples, const JobContext* job, Canvas& canvas) {
  const Shader shader(volume, colours, grid, rect);
  std::atomic<bool> stopped{false};
  constexpr int kBlock = 2, kTile = 16;  // pixels a side of a block that shares light; blocks a side of a task
  const auto draw = [&](const tbb::blocked_range2d<int>& tile) {
    if (job != nullptr && !job->Check().ok()) stopped = true;
    if (stopped) return;
    for (int row = tile.rows().begin(); row < tile.rows().end(); ++row) {
      for (int column = tile.cols().begin(); column < tile.cols().end(); ++column) {
        Shader::Shared shared;  // of one block, so that the picture does not depend on the split into tasks
        for (int pixel = 0; pixel < kBlock * kBlock; ++pixel) {
          const int x = column * kBlock + pixel % kBlock, y = row * kBlock + pixel / kBlock;
          if (x >= rect.width || y >= rect.height) continue;
          canvas.At(rect.x + x, rect.y + y) = shader.Pixel(rect.x + x, rect.y + y, samples, shared);
        }
      }
    }
  };
  const int columns = (rect.width + kBlock - 1) / kBlock, rows = (rect.height + kBlock - 1) / kBlock;
  tbb::parallel_for(tbb::blocked_range2d<int>(0, rows, kTile, 0, columns, kTile), draw);
  if (stopped) return job->Check();
  DrawAxes(shader, rect, canvas);
  return absl::OkStatus();
}

}  // namespace voxelpipe
