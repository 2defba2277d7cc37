// Ray traversal after J. Amanatides and A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987,
// inside cells with solid voxels; empty cells are skipped by their Chebyshev distance (D. Cohen and Z. Sheffer,
// "Proximity clouds", The Visual Computer 1994).
#include "encode/preview/preview_cells.h"

#include <tbb/blocked_range.h>
#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>

namespace voxelpipe {
namespace {

// The cells are walked a few times; more of them make shorter steps in a picture of a million rays, but longer walks.
constexpr uint64_t kMaxCells = uint64_t{1} << 20;

}  // namespace

absl::StatusOr<PreviewCells> PreviewCells::Build(const PreviewVolume& volume, const JobContext* job) {
  PreviewCells cells(volume, job);
  if (absl::Status s = cells.CountCells(job); !s.ok()) return s;
  cells.memory_.ShrinkTo(3 * cells.levels_[0].density.size());
  if (absl::Status s = cells.BuildDistances(job); !s.ok()) return s;
  cells.BuildLevels();
  return cells;
}

absl::Status PreviewCells::CountCells(const JobContext* job) {
  const std::array<int64_t, 3>& dims = volume_.dims();
  Level base;
  for (cell_ = 1;; cell_ *= 2) {
    double cells = 1;
    for (size_t a = 0; a < 3; ++a) {
      base.dims[a] = (dims[a] + cell_ - 1) / cell_;
      cells *= double(base.dims[a]);
    }
    if (cells <= double(kMaxCells)) break;
  }
  cell_shift_ = std::countr_zero(uint64_t(cell_));
  const auto cells = uint64_t(base.dims[0] * base.dims[1] * base.dims[2]);
  // Of a cell its density, twice for the levels above it as well, and its distance; its count for a while.
  if (absl::Status s = memory_.Grow(cells, 3 + sizeof(uint64_t), "the cells of a picture:"); !s.ok()) return s;
  base.density.resize(cells);
  std::vector<uint64_t> counts(cells);

  std::mutex mutex;
  std::atomic<bool> stopped{false};
  lo_ = dims;
  hi_ = {0, 0, 0};
  const double cell_voxels = double(cell_) * double(cell_) * double(cell_);
  const int shift = cell_shift_;
  tbb::parallel_for(tbb::blocked_range<int64_t>(0, base.dims[2], 1), [&](const auto& range) {
    std::array<int64_t, 3> lo = dims, hi{0, 0, 0};
    const int field = int(std::min<int64_t>(cell_, 32));
    const uint32_t mask = field == 32 ? ~0u : (1u << field) - 1;
    JobPoll poll(job);
    for (int64_t cz = range.begin(); cz < range.end(); ++cz) {
      if (!CheckJob(job).ok()) stopped = true;
      const int64_t end = volume_.FirstLayer((cz + 1) * cell_);
      for (int64_t n = volume_.FirstLayer(cz * cell_); n < end && !stopped; ++n) {
        const int64_t k = volume_.Layer(n);
        const absl::Status s = volume_.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t word) {
          lo = {std::min(lo[0], i + std::countr_zero(word)), std::min(lo[1], j), std::min(lo[2], k)};
          hi = {std::max(hi[0], i + 32 - std::countl_zero(word)), std::max(hi[1], j + 1), std::max(hi[2], k + 1)};
          uint64_t* const row = &counts[size_t(base.dims[0] * ((j >> shift) + base.dims[1] * cz))];
          for (int f = 0; f < 32; f += field) {
            const int set = std::popcount((word >> f) & mask);
            if (set != 0) row[(i + f) >> shift] += uint64_t(set);
          }
        });
        if (!s.ok()) stopped = true;
      }
      if (stopped) return;
      for (auto n = size_t(base.dims[0] * base.dims[1] * cz); n < size_t(base.dims[0] * base.dims[1] * (cz + 1)); ++n) {
        if (counts[n] != 0) base.density[n] = uint8_t(std::ceil(255.0 * double(counts[n]) / cell_voxels));
      }
    }
    const std::lock_guard lock(mutex);
    for (size_t a = 0; a < 3; ++a) {
      lo_[a] = std::min(lo_[a], lo[a]);
      hi_[a] = std::max(hi_[a], hi[a]);
    }
  });
  if (stopped) return job->Check();
  levels_.push_back(std::move(base));
  return absl::OkStatus();
}

absl::Status PreviewCells::BuildDistances(const JobContext* job) {
  JobPoll poll(job);
  // Exact Chebyshev distance in one forward and one backward sweep over the 26 neighbours. The 12 neighbours of other
  // rows are joined a row at a time, in loops that compilers vectorize.
  const Level& base = levels_[0];
  const int64_t nx = base.dims[0], ny = base.dims[1], nz = base.dims[2];  // clang 14 cannot capture bindings
  distance_.resize(base.density.size());
  for (size_t n = 0; n < distance_.size(); ++n) distance_[n] = base.density[n] != 0 ? 0 : 255;
  const auto further = [](uint8_t distance) { return uint8_t(std::min<uint8_t>(distance, 254) + 1); };
  std::vector<uint8_t> nearest(size_t(nx) + 2);  // of the rows before; a border of one cell at either end
  const auto sweep = [&](int direction) -> absl::Status {
    const auto join = [&](int64_t j, int64_t k) {
      if (j < 0 || k < 0 || j >= ny || k >= nz) return;
      const uint8_t* const row = &distance_[size_t(nx * (j + ny * k))];
      for (int64_t x = 0; x < nx; ++x) nearest[size_t(x) + 1] = std::min(nearest[size_t(x) + 1], row[x]);
    };
    for (int64_t step = 0; step < ny * nz; ++step) {
      if (absl::Status s = poll.Add(uint64_t(nx)); !s.ok()) return s;
      const int64_t line = direction > 0 ? step : ny * nz - 1 - step;
      const int64_t y = line % ny, z = line / ny;
      std::fill(nearest.begin(), nearest.end(), uint8_t{255});
      join(y - direction, z);
      for (int64_t j = y - 1; j <= y + 1; ++j) join(j, z - direction);
      uint8_t* const row = &distance_[size_t(nx * line)];
      const uint8_t* const around = nearest.data();
      for (int64_t x = 0; x < nx; ++x) {
        row[x] = std::min(row[x], further(std::min(std::min(around[x], around[x + 1]), around[x + 2])));
      }
      if (direction > 0) {
        for (int64_t x = 1; x < nx; ++x) row[x] = std::min(row[x], further(row[x - 1]));
      } else {
        for (int64_t x = nx - 2; x >= 0; --x) row[x] = std::min(row[x], further(row[x + 1]));
      }
    }
    return absl::OkStatus();
  };
  absl::Status s = sweep(1);
  return s.ok() ? sweep(-1) : s;
}

void PreviewCells::BuildLevels() {
  while (levels_.back().density.size() > 1) {
    const Level& fine = levels_.back();
    Level coarse;
    for (int a = 0; a < 3; ++a) coarse.dims[a] = (fine.dims[a] + 1) / 2;
    coarse.density.resize(size_t(coarse.dims[0] * coarse.dims[1] * coarse.dims[2]));
    tbb::parallel_for(
        tbb::blocked_range2d<int64_t>(0, coarse.dims[2], 1, 0, coarse.dims[1], 64), [&](const auto& part) {
          for (int64_t z = part.rows().begin(); z < part.rows().end(); ++z) {
            for (int64_t y = part.cols().begin(); y < part.cols().end(); ++y) {
              for (int64_t x = 0; x < coarse.dims[0]; ++x) {
                int sum = 0;
                for (int child = 0; child < 8; ++child) {
                  const int64_t i = 2 * x + child % 2, j = 2 * y + child / 2 % 2, k = 2 * z + child / 4;
                  if (i >= fine.dims[0] || j >= fine.dims[1] || k >= fine.dims[2]) continue;
                  sum += fine.density[size_t(i + fine.dims[0] * (j + fine.dims[1] * k))];
                }
                coarse.density[size_t(x + coarse.dims[0] * (y + coarse.dims[1] * z))] = uint8_t((sum + 7) / 8);
              }
            }
          }
        });
    levels_.push_back(std::move(coarse));
  }
}

template <bool kInBricks>
PreviewHit PreviewCells::TraceIn(const Vec3d& origin, const Vec3d& direction, double t_min, double t_max) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  PreviewHit hit;
  std::array<double, 3> from, along, inverse;
  for (int a = 0; a < 3; ++a) {
    const auto at = size_t(a);
    from[at] = origin[a];
    along[at] = direction[a];
    if (std::abs(along[at]) < 1e-12) {
      if (from[at] < double(lo_[at]) || from[at] > double(hi_[at])) return hit;
      inverse[at] = kInfinity;
      continue;
    }
    inverse[at] = 1 / along[at];
    double near = (double(lo_[at]) - from[at]) * inverse[at], far = (double(hi_[at]) - from[at]) * inverse[at];
    if (near > far) std::swap(near, far);
    if (near > t_min) {
      t_min = near;
      hit.axis = a;
    }
    t_max = std::min(t_max, far);
  }
  constexpr double kNudge = 1e-7;  // past the border of a box, so that the truncation falls inside the next one
  const Level& base = levels_[0];
  const std::array<int64_t, 3>& dims = volume_.dims();
  const std::array<int64_t, 3> stride{1, dims[0], dims[0] * dims[1]};
  const uint8_t* const bits = volume_.bits().data();
  std::array<int64_t, 3> brick{-1, -1, -1};  // the one that was looked up last
  const uint64_t* words = nullptr;           // its voxels, null if it has none
  const auto in_brick = [&](const std::array<int64_t, 3>& voxel) {
    const std::array<int64_t, 3> around{voxel[0] >> 3, voxel[1] >> 3, voxel[2] >> 3};
    if (around != brick) {
      brick = around;
      words = volume_.FindBrick(brick[0], brick[1], brick[2]);
    }
    return words != nullptr && (words[voxel[2] & 7] >> ((voxel[0] & 7) + 8 * (voxel[1] & 7)) & 1) != 0;
  };
  double t = t_min;
  while (t < t_max) {
    std::array<int64_t, 3> voxel, cell;
    const double inside = t + kNudge * (1 + std::abs(t));
    for (size_t a = 0; a < 3; ++a) {
      voxel[a] = std::clamp<int64_t>(int64_t(from[a] + along[a] * inside), 0, dims[a] - 1);
      cell[a] = voxel[a] >> cell_shift_;
    }
    const int64_t distance = distance_[size_t(cell[0] + base.dims[0] * (cell[1] + base.dims[1] * cell[2]))];
    // The parameter at which the ray leaves the box of cells [low, high) and the axis through which it does.
    double exit = kInfinity;
    int exit_axis = 0;
    const int64_t reach = std::max<int64_t>(distance, 1);
    for (size_t a = 0; a < 3; ++a) {
      if (inverse[a] == kInfinity) continue;
      const int64_t border = (along[a] > 0 ? cell[a] + reach : cell[a] - reach + 1) << cell_shift_;
      const double at = (double(border) - from[a]) * inverse[a];
      if (at < exit) {
        exit = at;
        exit_axis = int(a);
      }
    }
    if (distance == 0) {
      std::array<double, 3> next;
      std::array<int64_t, 3> left, step;  // voxels of the cell from here on; the next one in the linear order
      uint64_t n = volume_.Linear(voxel[0], voxel[1], voxel[2]);
      for (size_t a = 0; a < 3; ++a) {
        const bool ahead = along[a] > 0;
        next[a] = inverse[a] == kInfinity ? kInfinity : (double(voxel[a] + (ahead ? 1 : 0)) - from[a]) * inverse[a];
        const int64_t low = cell[a] << cell_shift_;
        left[a] = ahead ? std::min(low + cell_, dims[a]) - voxel[a] : voxel[a] - low + 1;
        step[a] = ahead ? stride[a] : -stride[a];
      }
      while (true) {
        bool solid = false;
        if constexpr (kInBricks) {
          solid = in_brick(voxel);
        } else {
          solid = bits[n / 8] >> (n % 8) & 1;
        }
        if (solid) {
          const auto nx = uint64_t(dims[0]), ny = uint64_t(dims[1]);
          hit.hit = t <= t_max;
          hit.voxel = {int64_t(n % nx), int64_t(n / nx % ny), int64_t(n / nx / ny)};
          hit.t = t;
          return hit;
        }
        const size_t a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
        if (--left[a] == 0) break;
        n += uint64_t(step[a]);
        if constexpr (kInBricks) voxel[a] += along[a] > 0 ? 1 : -1;
        t = std::max(t, next[a]);
        hit.axis = int(a);
        next[a] += std::abs(inverse[a]);
      }
    }
    hit.axis = exit_axis;
    t = std::max(exit, inside);
  }
  return hit;
}

PreviewHit PreviewCells::Trace(const Vec3d& origin, const Vec3d& direction, double t_min, double t_max) const {
  return volume_.in_bricks() ? TraceIn<true>(origin, direction, t_min, t_max)
                             : TraceIn<false>(origin, direction, t_min, t_max);
}

float PreviewCells::Density(int level, const Vec3d& p) const {
  const Level& data = levels_[size_t(std::min(level, levels() - 1))];
  const double size = CellSize(std::min(level, levels() - 1));
  int64_t base[3];
  float weight[3];
  for (int a = 0; a < 3; ++a) {
    const double q = p[a] / size - 0.5;
    const double floor = std::floor(q);
    if (floor < -1 || floor >= double(data.dims[a])) return 0;
    base[a] = int64_t(floor);
    weight[a] = float(q - floor);
  }
  const bool inside = base[0] >= 0 && base[1] >= 0 && base[2] >= 0 && base[0] + 1 < data.dims[0] &&
                      base[1] + 1 < data.dims[1] && base[2] + 1 < data.dims[2];
  if (inside) {
    const int64_t row = data.dims[0], plane = data.dims[0] * data.dims[1];
    const uint8_t* cells = &data.density[size_t(base[0] + row * base[1] + plane * base[2])];
    const auto along_x = [&](const uint8_t* at) { return float(at[0]) + weight[0] * float(at[1] - at[0]); };
    const auto across = [&](const uint8_t* at) {
      const float near = along_x(at);
      return near + weight[1] * (along_x(at + row) - near);
    };
    const float near = across(cells);
    return (near + weight[2] * (across(cells + plane) - near)) * (1.0f / 255.0f);
  }
  float sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
    const int64_t i = base[0] + dx, j = base[1] + dy, k = base[2] + dz;
    if (i < 0 || j < 0 || k < 0 || i >= data.dims[0] || j >= data.dims[1] || k >= data.dims[2]) continue;
    const float w =
        (dx ? weight[0] : 1 - weight[0]) * (dy ? weight[1] : 1 - weight[1]) * (dz ? weight[2] : 1 - weight[2]);
    sum += w * float(data.density[size_t(i + data.dims[0] * (j + data.dims[1] * k))]);
  }
  return sum * (1.0f / 255.0f);
}

}  // namespace voxelpipe
