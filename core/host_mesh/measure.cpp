// Sources: the Minkowski sum of a triangle and a box (surface.cpp) for the average number of voxels that a triangle
// touches, raster/clipped_triangle.h for its part in the grid. What averages miss - vertices on voxel corners, faces in
// the grid's planes, thin coverage, coinciding surfaces - is counted exactly in samples.
#include "host_mesh/measure.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "host_mesh/measure_cells.h"
#include "host_mesh/measure_fill.h"
#include "host_mesh/measure_sample.h"
#include "host_mesh/measure_touch.h"
#include "raster/spans.h"
#include "raster/tiles.h"

namespace voxelpipe {
namespace {

constexpr int64_t kGrain = 1 << 12;
constexpr double kSmallVoxels = 4096;  // larger boxes are of large triangles, for which averages are exact enough
constexpr uint64_t kSampledTriangles = 512;
constexpr uint64_t kSampledBricks = 192;
constexpr int64_t kMaxSampleDim = 32;         // voxels an axis; grids with larger cells use averages alone
constexpr int64_t kTrianglesOfSample = 2048;  // a brick with so many is almost full
// Maximum number of marked cells, apart from a few for each triangle: a hundred thousand triangles that each cross a
// whole large grid would take seconds.
constexpr uint64_t kMaxMarks = 1 << 24, kMinMarks = 16;
// The only lists of dense results are the pairs of tiles and triangles: in larger meshes a sample of the triangles
// estimates them well enough.
constexpr uint64_t kLookedAt = 1 << 16, kStepOfDense = 8;
constexpr double kListedBytesThatMatter = 4 << 20;
constexpr uint64_t kMinSampledMesh = 1 << 12;  // lists of smaller meshes are measured closely: that costs little

// Sums over triangles; always joined in the same order.
struct Sums {
  double small = 0, small_rows = 0;                      // fragments of small triangles, conservative
  double large = 0, large_rows = 0, area = 0, main = 0;  // of large ones; areas, and along the dominant axis
  double pairs = 0, crossings = 0, layers = 0;
  bool unmarked = false;  // some triangles had too many cells to mark
  double box_cells = 0;   // of the boxes of all triangles
  std::vector<double> shares;

  void Scale(double factor) {
    for (double* sum : {&small, &small_rows, &large, &large_rows, &area, &main, &pairs, &crossings, &layers}) {
      *sum *= factor;
    }
    for (double& share : shares) share *= factor;
  }
  void Add(const Sums& other) {
    small += other.small;
    small_rows += other.small_rows;
    large += other.large;
    large_rows += other.large_rows;
    area += other.area;
    main += other.main;
    pairs += other.pairs;
    crossings += other.crossings;
    layers += other.layers;
    unmarked = unmarked || other.unmarked;
    box_cells += other.box_cells;
    for (size_t i = 0; i < shares.size(); ++i) shares[i] += other.shares[i];
  }
};

// One touched cell in which voxels are counted.
struct Sample {
  Box box;  // voxels
  std::mutex mutex;
  std::atomic<int64_t> triangles = 0;
  std::vector<uint64_t> covered, shell;  // a bit a voxel; `shell`: conservative coverage, for a flood fill
};

class Measurer {
 public:
  Measurer(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid, const JobContext& job)
      : mesh_(mesh), request_(request), grid_(grid), job_(job), space_(grid.index_space()) {
    share_layers_ = LayersOfShare(grid);
    lists_ = request.result != ResultKind::kDense;
    marks_ = lists_ && request.coverage != Coverage::kNone;
    step_ = lists_ || mesh.triangle_count < kLookedAt ? 1 : kStepOfDense;
    if (lists_) cells_ = std::make_unique<Cells>(grid);
    marks_a_triangle_ = std::max(kMinMarks, kMaxMarks / std::max<uint64_t>(1, mesh.triangle_count));
  }

  absl::StatusOr<Surface> Run() {
    const Sums sums = Sum();
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    Surface out;
    if (request_.coverage != Coverage::kNone) {
      Correct(sums, out);
    } else {
      out.crossings = sums.crossings;
      out.layers = sums.layers;
    }
    const bool marked = marks_ && !sums.unmarked;
    if (marked) {
      CountCells(out);
    } else {
      SpreadBricks(out);
    }
    double shell = std::min(double(grid_.voxels()), sums.small + sums.large);
    if (marked && cells_->edge() <= kMaxSampleDim && sums.box_cells < double(kMaxMarks) &&
        MostListedBytes(HasSeparateShell(request_) ? shell : out.voxels) > kListedBytesThatMatter) {
      CountVoxels(out, shell);
    }
    if (!HasSeparateShell(request_)) shell = out.voxels;
    if (lists_ && request_.fill != Fill::kNone) CountFilled(mesh_, request_, grid_, job_, shell, *cells_, out);
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    out.share_layers = share_layers_;
    out.closely = true;
    return out;
  }

 private:
  Triangle At(uint64_t t) const { return TriangleAt(mesh_, space_, t); }

  // `marks`: cells that were marked in this chunk of triangles, of `most_marks`.
  void Add(const Triangle& t, uint64_t most_marks, uint64_t& marks, Sums& sums) {
    const auto [lo, hi] = BoundsOf(t);
    Touch touch;
    if (!TouchOf(t, lo, hi, grid_, touch)) return;
    const Vec3d& area = touch.part.area;
    if (touch.voxels <= kSmallVoxels) {
      sums.small += touch.fragments;
      sums.small_rows += touch.rows;
    } else {
      sums.large += touch.fragments;
      sums.large_rows += touch.rows;
      sums.area += area.x + area.y + area.z;
      sums.main += std::max({area.x, area.y, area.z});
    }
    sums.pairs += PairsOf(touch);
    sums.crossings += area.x;
    sums.layers += double(touch.box[2].second - touch.box[2].first + 1);
    const int64_t first = touch.box[2].first / share_layers_, last = touch.box[2].second / share_layers_;
    const double each = touch.fragments / double(last - first + 1);
    for (int64_t i = first; i <= last; ++i) sums.shares[size_t(i)] += each;
    if (!marks_ || sums.unmarked) return;
    sums.box_cells += Count(cells_->CellsOf(touch.box));
    if (marks > most_marks) {
      sums.unmarked = true;
      return;
    }
    cells_->ForEach(t, touch.box, [&](int64_t x, int64_t y, int64_t z) {
      cells_->Mark(x, y, z);
      ++marks;
    });
  }

  Sums Sum() {
    Sums none;
    none.shares.resize(size_t((grid_.dims[2] + share_layers_ - 1) / share_layers_));
    Sums sums = tbb::parallel_deterministic_reduce(
        tbb::blocked_range<uint64_t>(0, mesh_.triangle_count / step_, kGrain), none,
        [&](const tbb::blocked_range<uint64_t>& range, Sums part) {
          if (!job_.Check().ok()) return part;
          uint64_t marks = 0;
          const uint64_t most = marks_a_triangle_ * range.size();
          for (uint64_t i = range.begin(); i < range.end(); ++i) {
            Add(At(i * step_ + Scatter(i) % step_), most, marks, part);
          }
          return part;
        },
        [](Sums a, const Sums& b) {
          a.Add(b);
          return a;
        });
    sums.Scale(double(step_));
    return sums;
  }

  // Counts fragments and rows of a triangle within some voxels, exactly.
  template <typename Visit>
  void Rows(const Triangle& t, const VoxelRange& range, const Visit& visit) const {
    ForEachRowSpan(SetUpTriangle(t.a, t.b, t.c, request_.coverage), range, visit);
  }

  void Correct(const Sums& sums, Surface& out) const {
    double found = 0, rows = 0, expected = 0, expected_rows = 0;
    const uint64_t count = mesh_.triangle_count, step = std::max<uint64_t>(1, count / kSampledTriangles);
    for (uint64_t first = 0, i = 0; lists_ && first < count && sums.small > 0; first += step, ++i) {
      const uint64_t scattered = first + Scatter(i) % step;
      if (scattered >= count) break;
      const Triangle t = At(scattered);
      const auto [lo, hi] = BoundsOf(t);
      Touch touch;
      if (!TouchOf(t, lo, hi, grid_, touch) || touch.voxels > kSmallVoxels) continue;
      expected += touch.fragments;
      expected_rows += touch.rows;
      Rows(t, RangeOf(touch.box), [&](int64_t, int64_t, int64_t begin, int64_t end) {
        found += double(end - begin);
        rows += double((end - 1) / TileDim(0) - begin / TileDim(0) + 1);
      });
    }
    const double ratio = expected > 0 ? found / expected : 1;
    const double row_ratio = expected_rows > 0 ? rows / expected_rows : 1;
    const double large = request_.coverage == Coverage::kConservative || !(sums.area > 0) ? 1 : sums.main / sums.area;
    out.fragments = sums.small * ratio + sums.large * large;
    out.rows = std::min(out.fragments, sums.small_rows * row_ratio + sums.large_rows);
    out.pairs = sums.pairs;
    out.crossings = sums.crossings;
    out.layers = sums.layers;
    const double all = double(grid_.voxels());
    out.voxels = std::min(out.fragments, all);
    out.tiles = std::min(out.pairs, all / kTileVoxels + double(grid_.dims[1] * grid_.dims[2]) / 64 + 1);
    out.bricks = std::min(4 * out.pairs, all / 512 + 1);
    out.filled_bricks = out.bricks;
    const double scale = sums.small + sums.large > 0 ? out.fragments / (sums.small + sums.large) : 0;
    for (const double share : sums.shares) out.shares.push_back({share * scale, 0});
  }

  // If no cells were marked: from the fragments.
  void SpreadBricks(Surface& out) const {
    for (Surface::Share& share : out.shares) {
      share.bricks = out.fragments > 0 ? out.bricks * share.fragments / out.fragments : 0;
    }
  }

  void CountCells(Surface& out) const {
    const double layers_of_cell = double(cells_->edge());
    const double bricks_of_cell = BricksOfCell(*cells_);
    double bricks = 0, tiles = 0;
    const int64_t a_layer = cells_->dim(0) * cells_->dim(1), a_tile = std::max<int64_t>(1, TileDim(0) / cells_->edge());
    for (int64_t z = 0; z < cells_->dim(2); ++z) {
      double here = 0;
      for (int64_t row = 0; row < cells_->dim(1); ++row) {
        const int64_t first = z * a_layer + row * cells_->dim(0);
        for (int64_t x = 0; x < cells_->dim(0); x += a_tile) {
          // Past the empty rest of a word.
          const int64_t bit = (first + x) % 64, rest = (64 - bit) / a_tile * a_tile;
          if (rest > 0 && x + rest <= cells_->dim(0) && cells_->word((first + x) / 64) >> bit == 0) {
            x += rest - a_tile;
            continue;
          }
          int64_t touched = 0;
          for (int64_t i = x; i < std::min(cells_->dim(0), x + a_tile); ++i) touched += cells_->at(first + i);
          here += double(touched);
          tiles += touched > 0 ? 1 : 0;
        }
      }
      here *= bricks_of_cell;
      bricks += here;
      out.shares[size_t(double(z) * layers_of_cell) / size_t(share_layers_)].bricks += here;
    }
    const double most = out.bricks;
    out.bricks = cells_->edge() > 8 ? std::min(bricks, most) : bricks;
    out.tiles = std::min(out.tiles, tiles * bricks_of_cell);
    out.voxels = std::min(out.voxels, 512 * out.bricks);
    out.filled_bricks = out.bricks;
  }

  double MostListedBytes(double voxels) const {
    double value = 16;
    for (const TargetSpec& target : request_.targets) {
      value += double(target.components * BitsPerComponent(target.format)) / 8;
    }
    return value * voxels;
  }

  // Counts the covered voxels of some touched cells exactly.
  void CountVoxels(Surface& out, double& shell) const {
    uint64_t touched = 0;
    for (int64_t w = 0; w < cells_->words(); ++w) touched += uint64_t(std::popcount(cells_->word(w)));
    if (touched == 0) return;
    const auto count = size_t(std::min(touched, kSampledBricks));
    std::vector<Sample> samples(count);
    std::vector<std::pair<int64_t, size_t>> number;  // by cell
    uint64_t rank = 0;
    for (int64_t w = 0; w < cells_->words() && number.size() < count; ++w) {
      for (uint64_t left = cells_->word(w); left != 0 && number.size() < count; left &= left - 1, ++rank) {
        const size_t i = number.size();
        if (rank != i * touched / count) continue;  // evenly among the touched cells
        const int64_t cell = w * 64 + std::countr_zero(left);
        samples[i].box = cells_->VoxelsOfCell(cell);
        samples[i].covered.resize(size_t(Count(samples[i].box)) / 64 + 1);
        if (HasSeparateShell(request_)) samples[i].shell.resize(samples[i].covered.size());
        number.emplace_back(cell, i);
      }
    }
    std::vector<uint64_t> sampled(size_t(cells_->words()));
    for (const auto& [cell, i] : number) sampled[size_t(cell / 64)] |= uint64_t{1} << (cell % 64);
    ParallelChunks(int64_t(mesh_.triangle_count), kGrain, job_, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        const Triangle t = At(uint64_t(i));
        const auto [lo, hi] = BoundsOf(t);
        Box box;
        if (!VoxelsOf(lo, hi, grid_, box)) continue;
        const Box within = cells_->CellsOf(box);
        if (Count(within) > double(4 * count)) {
          for (Sample& sample : samples) Cover(t, box, sample);
          continue;
        }
        for (int64_t z = within[2].first; z <= within[2].second; ++z) {
          for (int64_t y = within[1].first; y <= within[1].second; ++y) {
            for (int64_t x = within[0].first; x <= within[0].second; ++x) {
              const int64_t cell = x + cells_->dim(0) * (y + cells_->dim(1) * z);
              if ((sampled[size_t(cell / 64)] >> (cell % 64) & 1) == 0) continue;
              const auto at = std::lower_bound(number.begin(), number.end(), std::pair<int64_t, size_t>(cell, 0));
              Cover(t, box, samples[at->second]);
            }
          }
        }
      }
    }).IgnoreError();  // the caller checks the job
    double voxels = 0, touching = 0;
    for (const Sample& sample : samples) {
      for (const uint64_t word : sample.covered) voxels += double(std::popcount(word));
      for (const uint64_t word : sample.shell) touching += double(std::popcount(word));
    }
    out.voxels = std::min(out.voxels, voxels * double(touched) / double(count));
    shell = std::min(shell, touching * double(touched) / double(count));
  }

  void Cover(const Triangle& t, const Box& voxels, Sample& sample) const {
    for (size_t i = 0; i < 3; ++i) {
      if (voxels[i].first > sample.box[i].second || voxels[i].second < sample.box[i].first) return;
    }
    if (++sample.triangles > kTrianglesOfSample) return;
    const std::lock_guard lock(sample.mutex);
    const int64_t nx = sample.box[0].second - sample.box[0].first + 1,
                  ny = sample.box[1].second - sample.box[1].first + 1;
    const auto set = [&](Coverage coverage, std::vector<uint64_t>& bits) {
      const auto setup = SetUpTriangle(t.a, t.b, t.c, coverage);
      ForEachRowSpan(setup, RangeOf(sample.box), [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
        const int64_t row = nx * ((y - sample.box[1].first) + ny * (z - sample.box[2].first)) - sample.box[0].first;
        for (int64_t x = x_begin; x < x_end; ++x) bits[size_t((row + x) / 64)] |= uint64_t{1} << ((row + x) % 64);
      });
    };
    set(request_.coverage, sample.covered);
    if (!sample.shell.empty()) set(Coverage::kConservative, sample.shell);
  }

  const MeshView& mesh_;
  const VoxelizeRequest& request_;
  const GridSpec& grid_;
  const JobContext& job_;
  const IndexSpace space_;
  std::unique_ptr<Cells> cells_;  // of lists
  int64_t share_layers_;
  uint64_t step_;  // one of so many triangles is sampled
  bool lists_, marks_;
  uint64_t marks_a_triangle_;  // cells, on average
};

}  // namespace

absl::StatusOr<Surface> MeasureSurface(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                       const JobContext& job) {
  return Measurer(mesh, request, grid, job).Run();
}

absl::StatusOr<Surface> SampleSurface(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                      const JobContext& job) {
  if (request.result == ResultKind::kDense) return SampleDense(mesh, request, grid, job);
  if (mesh.triangle_count >= kMinSampledMesh) {
    absl::StatusOr<std::optional<Surface>> sampled = SampleLists(mesh, request, grid, job);
    if (!sampled.ok()) return sampled.status();
    if (*sampled) return **std::move(sampled);
  }
  return MeasureSurface(mesh, request, grid, job);
}

}  // namespace voxelpipe
