#include "host_mesh/measure_fill.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <utility>
#include <vector>

#include "base/parallel.h"

namespace voxelpipe {
namespace {

constexpr int64_t kGrain = 1 << 12;
constexpr int64_t kLinesAnAxis = 24;
constexpr uint64_t kMaxCrossings = 1024;  // of a line, that are stored
constexpr double kBesideCentre = 1e-4;    // voxels, of a line
constexpr double kOpenLines = 0.2;        // closed surfaces have none, up to rounding

// The point where the line (y, z) along x crosses the triangle.
bool CrossLine(const Triangle& t, double y, double z, std::pair<double, int>& out) {
  const auto side = [&](const Vec3d& p, const Vec3d& q) { return (q.y - p.y) * (z - p.z) - (q.z - p.z) * (y - p.y); };
  const double ab = side(t.a, t.b), bc = side(t.b, t.c), ca = side(t.c, t.a), sum = ab + bc + ca;
  if (!((ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0)) || sum == 0) return false;
  out = {(bc * t.a.x + ca * t.b.x + ab * t.c.x) / sum, sum > 0 ? 1 : -1};
  return true;
}

// Which triangles lie between two neighbouring ones of the lines, along an axis: most of a fine mesh.
class Between {
 public:
  Between(const GridSpec& grid, int axis, int64_t lines) : axis_(axis) {
    const double apart = double(grid.dims[size_t(axis)]) / double(lines);  // voxels
    scale_ = 1 / (apart * grid.voxel_size[axis]);
    offset_ = -grid.origin[axis] * scale_ - kBesideCentre / apart - 0.5;
  }
  // False where that is in doubt.
  bool Has(const MeshView& mesh, uint64_t t) const {
    constexpr double kNear = 1e-6;  // of the distance of two lines
    const uint32_t* const v = mesh.triangles[t];
    const auto at = [&](int i) { return mesh.positions[v[i]][axis_] * scale_ + offset_; };
    const double a = at(0), b = at(1), c = at(2);
    return std::floor(Max(a, Max(b, c)) + kNear) < std::ceil(Min(a, Min(b, c)) - kNear);
  }

 private:
  int axis_;
  double scale_, offset_;  // from world units to numbers of lines
};

// The share of the grid that is inside; `open`: the share of lines with an odd number of crossings among those with
// any.
double FilledShare(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid, const JobContext& job,
                   double& open) {
  const IndexSpace space = grid.index_space();
  const int64_t ny = std::min(kLinesAnAxis, grid.dims[1]), nz = std::min(kLinesAnAxis, grid.dims[2]);
  std::vector<std::vector<std::pair<double, int>>> lines(size_t(ny * nz));  // position and sign of each crossing
  std::vector<std::atomic<uint64_t>> crossings(lines.size());
  std::vector<std::mutex> locks(lines.size());
  // Between voxel centres, but as many on average.
  const auto place = [](int64_t i, int64_t count, int64_t dim) {
    return (double(i) + 0.5) * double(dim) / double(count) + kBesideCentre;
  };
  const auto from = [](double p, int64_t count, int64_t dim) {  // the first line at or after p
    return std::clamp(std::ceil((p - kBesideCentre) * double(count) / double(dim) - 0.5), 0.0, double(count));
  };
  const Between y_lines(grid, 1, ny), z_lines(grid, 2, nz);
  ParallelChunks(int64_t(mesh.triangle_count), kGrain, job, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (y_lines.Has(mesh, uint64_t(i)) || z_lines.Has(mesh, uint64_t(i))) continue;
      const Triangle t = TriangleAt(mesh, space, uint64_t(i));
      const auto [lo, hi] = BoundsOf(t);
      if (!IsWithinReach(lo, hi)) continue;
      const auto y_end = int64_t(from(hi.y, ny, grid.dims[1])), z_end = int64_t(from(hi.z, nz, grid.dims[2]));
      for (auto z = int64_t(from(lo.z, nz, grid.dims[2])); z < z_end; ++z) {
        for (auto y = int64_t(from(lo.y, ny, grid.dims[1])); y < y_end; ++y) {
          const auto at = size_t(y + ny * z);
          if (crossings[at].load(std::memory_order_relaxed) > kMaxCrossings) continue;
          std::pair<double, int> x;
          if (!CrossLine(t, place(y, ny, grid.dims[1]), place(z, nz, grid.dims[2]), x)) continue;
          const std::lock_guard lock(locks[at]);
          if (++crossings[at] <= kMaxCrossings) lines[at].push_back(x);
        }
      }
    }
  }).IgnoreError();
  constexpr double kOneSurface = 1e-6;  // voxels between crossings of the same surface, repeated
  const bool flood = request.fill == Fill::kFlood;
  const double nx = double(grid.dims[0]);
  double length = 0, odd = 0, crossed = 0;
  for (size_t at = 0; at < lines.size(); ++at) {
    auto& line = lines[at];
    if (crossings[at] > kMaxCrossings) {  // counts as inside along its whole length
      length += nx;
      ++crossed;
      continue;
    }
    std::sort(line.begin(), line.end());
    crossed += line.empty() ? 0 : 1;
    int winding = 0;
    size_t surfaces = 0;  // crossed so far
    for (size_t i = 0; i < line.size(); ++i) {
      winding += line[i].second;
      const double end = i + 1 < line.size() ? line[i + 1].first : nx;
      // A flood ignores how many surfaces coincide, and fills overlaps.
      if (flood && i + 1 < line.size() && end - line[i].first < kOneSurface) continue;
      ++surfaces;
      bool inside = surfaces % 2 == 1;
      if (request.fill == Fill::kNonzero) inside = winding != 0;
      if (flood || FillsParts(request)) inside = inside || winding != 0;
      if (inside) length += std::clamp(end, 0.0, nx) - std::clamp(line[i].first, 0.0, nx);
    }
    odd += double(surfaces % 2);
  }
  open = crossed > 0 ? odd / crossed : 0;
  return length / (nx * double(lines.size()));
}

}  // namespace

void CountFilled(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid, const JobContext& job,
                 double shell, const Cells& cells, Surface& out) {
  const double all = double(grid.voxels());
  double open = 0;
  const double filled = FilledShare(mesh, request, grid, job, open) * all;
  // Half of the voxels of a surface have their centre inside.
  out.inside = std::max(0.0, filled - 0.5 * out.voxels);
  if (request.fill == Fill::kFlood) {
    // What the flood does not reach: the conservative shell, for every coverage, and what it encloses. A surface with
    // holes encloses nothing, unless few lines are open.
    const double closed = open > kOpenLines ? 0 : std::max(0.0, filled - 0.5 * shell);
    out.inside = shell > 0.4 * all ? all : shell - out.voxels + closed;
  }
  out.inside = std::min(out.inside, all - out.voxels);
  const double bricks = std::max(all / 512, double(cells.count()));
  out.filled_bricks = std::min(bricks, out.bricks + 1.5 * out.inside / 512);
}

}  // namespace voxelpipe
