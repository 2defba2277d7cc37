// What a dense result's memory follows from, besides its grid: pairs of triangles and tiles, the layers of each
// triangle, and with a fill that casts lines its crossings.
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>

#include "host_mesh/measure_cells.h"
#include "host_mesh/measure_sample.h"
#include "host_mesh/measure_touch.h"
#include "pipeline/plan/footprint_parts.h"
#include "raster/row_bits_fit.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kSample = 1 << 9;
// What none of n samples shows happens less often than 3 times in n, in 95 of 100 cases (J. Hanley and A.
// Lippman-Hand, "If Nothing Goes Wrong, Is Everything All Right?", JAMA 249, 1983): triangles through all layers.
constexpr double kUnseen = 3;
// Rows of bits need no tiles: of few triangles all may reach through all layers, and lists of them take little.
constexpr double kFewLayers = 1 << 22;
constexpr uint64_t kAllCrossed = 1 << 16, kStepOfCrossings = 8;  // of larger meshes one triangle of so many
constexpr uint64_t kGrain = 1 << 12;

// Lines along x through voxel centres that cross the triangles. A few large triangles may have most of them, and a run
// does not count them: more than a sample is looked at.
double SumCrossings(const MeshView& mesh, const GridSpec& grid, const IndexSpace& space, const JobContext& job) {
  const uint64_t step = mesh.triangle_count < kAllCrossed ? 1 : kStepOfCrossings;
  const Vec3d& h = grid.voxel_size;
  const Vec3d begin = grid.origin;
  const Vec3d end{begin.x + double(grid.dims[0]) * h.x, begin.y + double(grid.dims[1]) * h.y,
                  begin.z + double(grid.dims[2]) * h.z};
  const double sum = tbb::parallel_deterministic_reduce(
      tbb::blocked_range<uint64_t>(0, mesh.triangle_count / step, kGrain), 0.0,
      [&](const tbb::blocked_range<uint64_t>& range, double part) {
        if (!job.Check().ok()) return part;
        for (uint64_t i = range.begin(); i < range.end(); ++i) {
          const uint64_t t = step == 1 ? i : i * step + Scatter(i) % step;
          const uint32_t* const v = mesh.triangles[t];
          const Vec3d &a = mesh.positions[v[0]], &b = mesh.positions[v[1]], &c = mesh.positions[v[2]];
          bool inside = true;
          for (int k = 0; k < 3; ++k) {
            inside = inside && Min(a[k], Min(b[k], c[k])) >= begin[k] && Max(a[k], Max(b[k], c[k])) <= end[k];
          }
          if (inside) {  // by one division at a time: squares of small voxels' edges may be 0
            const Vec3d p{0, (b.y - a.y) / h.y, (b.z - a.z) / h.z}, q{0, (c.y - a.y) / h.y, (c.z - a.z) / h.z};
            part += 0.5 * Abs(p.y * q.z - p.z * q.y);
            continue;
          }
          const Triangle clipped = TriangleAt(mesh, space, t);
          const auto [lo, hi] = BoundsOf(clipped);
          Touch touch;
          if (TouchOf(clipped, lo, hi, grid, touch)) part += touch.part.area.x;
        }
        return part;
      },
      [](double a, double b) { return a + b; });
  return sum * double(step);
}

}  // namespace

absl::StatusOr<Surface> SampleDense(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                    const JobContext& job) {
  const IndexSpace space = grid.index_space();
  const uint64_t count = mesh.triangle_count;
  Surface out;
  out.layers = double(count) * double(grid.dims[2]);
  const bool rows = footprint::PlainBits(request) && !FillsParts(request) && RowBitsFit(grid, count);
  const uint64_t samples = rows && out.layers < kFewLayers ? 0 : std::min(count, kSample);
  const double weight = double(count) / double(std::max<uint64_t>(1, samples));
  if (samples > 0) out.layers = samples < count ? kUnseen * weight * double(grid.dims[2]) : 0;
  for (uint64_t i = 0; i < samples; ++i) {
    const uint64_t first = i * count / samples, end = (i + 1) * count / samples;
    const Triangle t = TriangleAt(mesh, space, first + Scatter(i) % (end - first));
    const auto [lo, hi] = BoundsOf(t);
    Touch touch;
    if (!TouchOf(t, lo, hi, grid, touch)) continue;
    out.layers += weight * double(touch.box[2].second - touch.box[2].first + 1);
    if (request.coverage == Coverage::kNone) continue;
    out.pairs += weight * PairsOf(touch);
    out.fragments += weight * touch.fragments;  // for RescaleSurface
  }
  const double all = double(grid.voxels());
  out.tiles = std::min(out.pairs, all / kTileVoxels + double(grid.dims[1] * grid.dims[2]) / 64 + 1);
  if (CastsLines(request.fill)) out.crossings = SumCrossings(mesh, grid, space, job);
  if (absl::Status s = job.Check(); !s.ok()) return s;
  out.doubt = kDoubtOfSample;
  return out;
}

}  // namespace voxelpipe
