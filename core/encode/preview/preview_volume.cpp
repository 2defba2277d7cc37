// Ray traversal after J. Amanatides and A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987,
// inside cells with solid voxels; empty cells are skipped by their Chebyshev distance (D. Cohen and Z. Sheffer,
// "Proximity clouds", The Visual Computer 1994).
#include "encode/preview/preview_volume.h"

#include <tbb/blocked_range.h>
#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>

#include "absl/strings/str_cat.h"
#include "encode/preview/preview_values.h"

namespace voxelpipe {
namespace {

// The cells are walked a few times; more of them make shorter steps in a picture of a million rays, but longer walks.
constexpr uint64_t kMaxCells = uint64_t{1} << 20;

constexpr uint64_t kMaxOwnBits = uint64_t{1} << 34;  // 2 GiB

// The bits of the voxels with a component of the target other than `clear`.
void SetNotClear(const VoxelizeResult& result, size_t target, std::vector<uint8_t>& bits) {
  const TargetSpec& spec = result.specs[target];
  const uint64_t voxels = result.grid.voxels();
  const TargetValues values(result, target, voxels);
  const uint32_t cell = NumberToCell(spec.clear, spec.format);
  const float clear = IsInteger(spec.format) ? float(cell) : FloatOf(cell);
  // Eight voxels that hold the very bits of `clear` are passed over at once: most of a grid is empty.
  const auto element = uint64_t(BitsPerComponent(spec.format) / 8), components = uint64_t(spec.components);
  const uint64_t planes = result.layout == Layout::kPlanar ? components : 1;
  const uint64_t run = 8 * element * components / planes;  // bytes of eight voxels in a plane
  std::vector<uint8_t> all_clear(run);
  const uint32_t stored = StoredBits(cell, spec.format);
  for (uint64_t at = 0; at < run; at += element) std::memcpy(&all_clear[at], &stored, element);  // little endian
  const auto is_clear = [&](uint64_t byte) {
    for (uint64_t plane = 0; plane < planes; ++plane) {
      const uint8_t* const first = result.targets[target].data() + plane * voxels * element + byte * run;
      if (std::memcmp(first, all_clear.data(), run) != 0) return false;
    }
    return !std::isnan(clear);  // which differs from itself
  };
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, bits.size(), 1 << 14), [&](const auto& range) {
    for (uint64_t byte = range.begin(); byte < range.end(); ++byte) {
      const uint64_t end = std::min(voxels, 8 * byte + 8);
      if (end == 8 * byte + 8 && is_clear(byte)) continue;
      for (uint64_t n = 8 * byte; n < end; ++n) {
        for (int c = 0; c < spec.components; ++c) {
          if (values.At(n, c) != clear) {
            bits[byte] |= uint8_t(1 << (n % 8));
            break;
          }
        }
      }
    }
  });
}

// The bits of the voxels that a sparse or bucketed result lists.
void SetListed(const VoxelizeResult& result, std::vector<uint8_t>& bits) {
  const auto set = [&](uint64_t n) { bits[n / 8] |= uint8_t(1 << (n % 8)); };
  if (result.kind == ResultKind::kBuckets) {
    const auto* voxels = reinterpret_cast<const uint64_t*>(result.voxels.data());
    for (uint64_t i = 0; i < result.listed_voxels(); ++i) set(voxels[i]);
    return;
  }
  const auto& dims = result.grid.dims;
  const auto* bricks = reinterpret_cast<const uint64_t*>(result.bricks.data());
  const uint64_t across = uint64_t(dims[0] + 7) / 8, rows = uint64_t(dims[1] + 7) / 8;
  for (uint64_t b = 0; b < result.listed_bricks(); ++b) {
    const uint64_t x = 8 * (bricks[b] % across), y = 8 * (bricks[b] / across % rows),
                   z = 8 * (bricks[b] / across / rows);
    for (uint64_t row = 0; row < 64; ++row) {
      const uint64_t j = y + row % 8, k = z + row / 8;
      if (j >= uint64_t(dims[1]) || k >= uint64_t(dims[2])) continue;
      for (unsigned mask = result.masks.data()[64 * b + row]; mask != 0; mask &= mask - 1) {
        const uint64_t i = x + uint64_t(std::countr_zero(mask));
        if (i < uint64_t(dims[0])) set(i + uint64_t(dims[0]) * (j + uint64_t(dims[1]) * k));
      }
    }
  }
}

}  // namespace

absl::StatusOr<PreviewVolume> PreviewVolume::Build(const VoxelizeResult& result, const JobContext* job) {
  if (result.targets.empty()) return absl::InvalidArgumentError("a drawing needs a result with at least one target");
  if (absl::Status status = CheckArrays(result); !status.ok()) return status;
  PreviewVolume volume;
  volume.dims_ = result.grid.dims;
  size_t shown = 0;
  for (size_t i = result.specs.size(); i-- > 0;) {
    if (result.specs[i].format == VoxelFormat::kBit) shown = i;
  }
  if (result.kind == ResultKind::kDense && result.specs[shown].format == VoxelFormat::kBit) {
    volume.bits_ = result.targets[shown].bytes();
  } else {
    const uint64_t voxels = result.grid.voxels();
    if (voxels > kMaxOwnBits) {
      return absl::ResourceExhaustedError(
          absl::StrCat("a drawing needs a bit a voxel, here ", voxels / 8, " bytes; the limit is ", kMaxOwnBits / 8));
    }
    volume.own_bits_.resize((voxels + 7) / 8);
    if (result.kind == ResultKind::kDense) {
      SetNotClear(result, shown, volume.own_bits_);
    } else {
      SetListed(result, volume.own_bits_);
    }
    volume.bits_ = volume.own_bits_;
  }
  if (absl::Status status = volume.CountCells(job); !status.ok()) return status;
  volume.BuildDistances();
  volume.BuildLevels();
  return volume;
}

uint32_t PreviewVolume::Row(int64_t i, int64_t j, int64_t k, int count) const {
  if (j < 0 || k < 0 || j >= dims_[1] || k >= dims_[2] || i >= dims_[0] || i + count <= 0) return 0;
  const int skipped = i < 0 ? int(-i) : 0;
  const int64_t first = i + skipped;
  const int taken = int(std::min<int64_t>(count - skipped, dims_[0] - first));
  const uint64_t bit = Linear(first, j, k);
  uint64_t word = 0;
  if (bit / 8 + sizeof(word) <= bits_.size()) {
    std::memcpy(&word, bits_.data() + bit / 8, sizeof(word));  // of a constant size: one load
  } else {
    std::memcpy(&word, bits_.data() + bit / 8, bits_.size() - bit / 8);
  }
  return uint32_t(((word >> (bit % 8)) & ((uint64_t{1} << taken) - 1)) << skipped);
}

absl::Status PreviewVolume::CountCells(const JobContext* job) {
  Level base;
  for (cell_ = 1;; cell_ *= 2) {
    double cells = 1;
    for (int a = 0; a < 3; ++a) {
      base.dims[a] = (dims_[a] + cell_ - 1) / cell_;
      cells *= double(base.dims[a]);
    }
    if (cells <= double(kMaxCells)) break;
  }
  cell_shift_ = std::countr_zero(uint64_t(cell_));
  base.density.resize(size_t(base.dims[0] * base.dims[1] * base.dims[2]));

  std::mutex mutex;
  std::atomic<bool> stopped{false};
  lo_ = dims_;
  hi_ = {0, 0, 0};
  const double cell_voxels = double(cell_) * double(cell_) * double(cell_);
  tbb::parallel_for(tbb::blocked_range<int64_t>(0, base.dims[2], 1), [&](const auto& range) {
    std::vector<uint64_t> count(size_t(base.dims[0]));
    std::array<int64_t, 3> lo = dims_, hi{0, 0, 0};
    const int chunk = 32, field = int(std::min<int64_t>(cell_, chunk));
    const uint32_t mask = field == 32 ? ~0u : (1u << field) - 1;
    for (int64_t cz = range.begin(); cz < range.end(); ++cz) {
      if (job != nullptr && !job->Check().ok()) stopped = true;
      if (stopped) return;
      for (int64_t cy = 0; cy < base.dims[1]; ++cy) {
        std::fill(count.begin(), count.end(), 0);
        for (int64_t k = cz * cell_; k < std::min(dims_[2], (cz + 1) * cell_); ++k) {
          for (int64_t j = cy * cell_; j < std::min(dims_[1], (cy + 1) * cell_); ++j) {
            for (int64_t i = 0; i < dims_[0]; i += chunk) {
              const uint32_t word = Row(i, j, k, chunk);
              if (word == 0) continue;
              lo = {std::min(lo[0], i + std::countr_zero(word)), std::min(lo[1], j), std::min(lo[2], k)};
              hi = {std::max(hi[0], i + 32 - std::countl_zero(word)), std::max(hi[1], j + 1), std::max(hi[2], k + 1)};
              for (int f = 0; f < chunk; f += field) {
                const int set = std::popcount((word >> f) & mask);
                if (set != 0) count[size_t((i + f) / cell_)] += uint64_t(set);
              }
            }
          }
        }
        uint8_t* row = &base.density[size_t(base.dims[0] * (cy + base.dims[1] * cz))];
        for (int64_t cx = 0; cx < base.dims[0]; ++cx) {
          if (count[size_t(cx)] != 0) row[cx] = uint8_t(std::ceil(255.0 * double(count[size_t(cx)]) / cell_voxels));
        }
      }
    }
    const std::lock_guard lock(mutex);
    for (int a = 0; a < 3; ++a) {
      lo_[a] = std::min(lo_[a], lo[a]);
      hi_[a] = std::max(hi_[a], hi[a]);
    }
  });
  if (stopped) return job->Check();
  levels_.push_back(std::move(base));
  return absl::OkStatus();
}

void PreviewVolume::BuildDistances() {
  // Exact Chebyshev distance in one forward and one backward sweep over the 26 neighbours. The 12 neighbours of other
  // rows are joined a row at a time, in loops that compilers vectorize.
  const Level& base = levels_[0];
  const int64_t nx = base.dims[0], ny = base.dims[1], nz = base.dims[2];  // clang 14 cannot capture bindings
  distance_.resize(base.density.size());
  for (size_t n = 0; n < distance_.size(); ++n) distance_[n] = base.density[n] != 0 ? 0 : 255;
  const auto further = [](uint8_t distance) { return uint8_t(std::min<uint8_t>(distance, 254) + 1); };
  std::vector<uint8_t> nearest(size_t(nx) + 2);  // of the rows before; a border of one cell at either end
  const auto sweep = [&](int direction) {
    const auto join = [&](int64_t j, int64_t k) {
      if (j < 0 || k < 0 || j >= ny || k >= nz) return;
      const uint8_t* const row = &distance_[size_t(nx * (j + ny * k))];
      for (int64_t x = 0; x < nx; ++x) nearest[size_t(x) + 1] = std::min(nearest[size_t(x) + 1], row[x]);
    };
    for (int64_t step = 0; step < ny * nz; ++step) {
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
  };
  sweep(1);
  sweep(-1);
}

void PreviewVolume::BuildLevels() {
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

PreviewHit PreviewVolume::Trace(const Vec3d& origin, const Vec3d& direction, double t_min, double t_max) const {
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
  const std::array<int64_t, 3> stride{1, dims_[0], dims_[0] * dims_[1]};
  const uint8_t* const bits = bits_.data();
  double t = t_min;
  while (t < t_max) {
    std::array<int64_t, 3> voxel, cell;
    const double inside = t + kNudge * (1 + std::abs(t));
    for (size_t a = 0; a < 3; ++a) {
      voxel[a] = std::clamp<int64_t>(int64_t(from[a] + along[a] * inside), 0, dims_[a] - 1);
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
      uint64_t n = Linear(voxel[0], voxel[1], voxel[2]);
      for (size_t a = 0; a < 3; ++a) {
        const bool ahead = along[a] > 0;
        next[a] = inverse[a] == kInfinity ? kInfinity : (double(voxel[a] + (ahead ? 1 : 0)) - from[a]) * inverse[a];
        const int64_t low = cell[a] << cell_shift_;
        left[a] = ahead ? std::min(low + cell_, dims_[a]) - voxel[a] : voxel[a] - low + 1;
        step[a] = ahead ? stride[a] : -stride[a];
      }
      while (true) {
        if (bits[n / 8] >> (n % 8) & 1) {
          const auto nx = uint64_t(dims_[0]), ny = uint64_t(dims_[1]);
          hit.hit = t <= t_max;
          hit.voxel = {int64_t(n % nx), int64_t(n / nx % ny), int64_t(n / nx / ny)};
          hit.t = t;
          return hit;
        }
        const size_t a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
        if (--left[a] == 0) break;
        n += uint64_t(step[a]);
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

float PreviewVolume::Density(int level, const Vec3d& p) const {
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
