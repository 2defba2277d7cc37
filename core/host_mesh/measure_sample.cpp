// Sources: A. Chao and C.-W. Lin, "Nonparametric Lower Bounds for Species Richness and Shared Species Richness under
// Sampling without Replacement", Biometrics 68, 2012: how many voxels a mesh covers, from how often the triangles of a
// sample cover the same one. P. Flajolet, "On Adaptive Sampling", Computing 43, 1990: counting in a table of fixed
// size. The bound is low where triangles are spread unevenly. Weighted by the triangles' areas it is not, unless the
// surface coincides with itself; the area is a bound from above.
#include "host_mesh/measure_sample.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "host_mesh/measure_cells.h"
#include "host_mesh/measure_fill.h"
#include "host_mesh/measure_touch.h"

namespace voxelpipe {
namespace {

constexpr size_t kGrain = 1 << 12, kGrainOfSample = 128;
// Pairs of triangles that cover the same voxel are as many in samples of meshes of all sizes, if samples grow with the
// square root.
constexpr double kSampleOfRoot = 4, kMinSample = 1 << 10, kMaxSample = 1 << 14;
constexpr uint64_t kFewSampled = 256;  // too few to say anything
constexpr uint64_t kPilot = 256;       // triangles that say how large most are
// Triangles whose boxes have more voxels than so many times the average are measured all, so that a sample misses
// nothing that matters; so are those of averages exact enough.
constexpr double kLarger = 32, kMinLarge = 64, kMaxSmall = 4096;
constexpr uint64_t kMaxLargeShare = 8;   // of the mesh; beyond, it is measured closely ...
constexpr uint64_t kMaxLarge = 1 << 18;  // ... as with more than so many, ...
constexpr double kMaxMarks = 1 << 22;    // ... of more cells, ...
constexpr double kMaxLayers = 2;         // ... or of so many on each other in their cells
constexpr double kMaxCounted = 1 << 16;  // voxels of the sample that are counted; of more, a part
// Of the low estimate: what is taken at most, and where the high one must be. Beyond it the surface may coincide with
// itself everywhere or in parts, and a sample does not tell the two apart.
constexpr double kMaxTakenRatio = 1.5, kMaxBoundRatio = 2;
constexpr double kOfArea = 1.12, kFewBoxes = 64;  // boxes that a surface touches (plan/surface.cpp)

uint64_t HashOf(uint64_t key) {  // the finalizer of MurmurHash3 (A. Appleby, 2011)
  key = (key ^ key >> 33) * 0xFF51AFD7ED558CCDull;
  key = (key ^ key >> 33) * 0xC4CEB9FE1A85EC53ull;
  return key ^ key >> 33;
}

// A place that a triangle touches, and the part of its area that lies there if it lies evenly in all such places.
struct Sighting {
  uint64_t place = 0;
  double area = 0;
};

// How often each place was seen, in a table of fixed size: of many places, those whose hashes end in zeros.
class Sightings {
 public:
  // `skipped`: bits of the hashes that are zero of all places that will be added; one less than a power of two.
  explicit Sightings(uint64_t skipped) : slots_(kSlots), skipped_(skipped) {}

  void Add(const Sighting& seen) {
    const uint64_t hash = HashOf(seen.place);
    if ((hash & skipped_) != 0) return;
    Slot& slot = Find(slots_, seen.place, hash);
    slot.area += seen.area;
    if (slot.times++ != 0) return;
    slot.place = seen.place;
    if (++kept_ > kSlots / 4 * 3) Halve();
  }

  // How many places there are, seen or not.
  struct Places {
    double least = 0, most = 0;  // a low estimate, two standard errors apart
    double bound = 0;            // a high one
  };
  // In: the share of all triangles that were sampled; how many places a surface of all their area touches; how many
  // they touch one by one.
  Places Estimate(double sampled, double of_area, double of_each) const {
    double once = 0, twice = 0, area = 0, area_once = 0, others = 0, squares = 0;
    for (const Slot& slot : slots_) {
      if (slot.times == 0) continue;
      once += slot.times == 1 ? 1 : 0;
      twice += slot.times == 2 ? 1 : 0;
      area += slot.area;
      area_once += slot.times == 1 ? slot.area : 0;
      const double here = slot.area * double(slot.times - 1);
      others += here;
      squares += here * here;
    }
    const double weight = double(skipped_ + 1), seen = weight * double(kept_);
    const double odds = sampled / std::max(1e-9, 1 - sampled);
    const auto all = [&](double times) {
      return seen + weight * once * std::max(0.0, once - 1) / (2 * times + odds * once);
    };
    constexpr double kLeast = 0.1;
    Places out;
    out.least = all(twice + 1);
    out.most = all(std::max(kLeast, twice - std::sqrt(twice)));
    out.bound = std::min(of_area, of_each);
    if (!(area > 0)) return out;
    // How many triangles touch a place, on average over the area: of a surface that does not coincide with itself that
    // is the average over its places, wherever its triangles are small.
    const auto by_area = [&](double sum) { return of_each / (1 + std::max(0.0, sum) / (sampled * area)); };
    out.least = std::max(out.least, by_area(others + std::sqrt(squares)));
    out.most = std::max(out.most, by_area(others - std::sqrt(squares)));
    // The part of the area that lies in places that were not seen is about that in places that were seen once.
    out.bound = std::min(out.bound, seen + area_once / area * of_area);
    return out;
  }

  template <typename Visit>
  void ForEachKept(const Visit& visit) const {
    for (const Slot& slot : slots_) {
      if (slot.times != 0) visit(slot.place);
    }
  }

 private:
  struct Slot {
    uint64_t place = 0;
    uint32_t times = 0;
    double area = 0;  // of what was seen in it
  };
  static constexpr size_t kSlots = 1 << 14;

  static Slot& Find(std::vector<Slot>& slots, uint64_t place, uint64_t hash) {
    size_t i = size_t(hash >> 40) % kSlots;
    while (slots[i].times != 0 && slots[i].place != place) i = (i + 1) % kSlots;
    return slots[i];
  }
  // Forgets half of the places.
  void Halve() {
    skipped_ = 2 * skipped_ + 1;
    kept_ = 0;
    std::vector<Slot> half(kSlots);
    for (const Slot& slot : slots_) {
      const uint64_t hash = HashOf(slot.place);
      if (slot.times == 0 || (hash & skipped_) != 0) continue;
      Find(half, slot.place, hash) = slot;
      ++kept_;
    }
    slots_ = std::move(half);
  }

  std::vector<Slot> slots_;
  uint64_t skipped_;
  uint64_t kept_ = 0;
};

// The triangles that are measured, by ascending id.
struct Picked {
  std::vector<uint64_t> large, sample;
  uint64_t small = 0;  // that may touch the grid; `sample` is of them
};

// Sums over triangles.
struct Sums {
  double fragments = 0, squares = 0, rows = 0, pairs = 0, crossings = 0, layers = 0;
  double area = 0, main = 0;  // along all axes, and along each triangle's dominant one
  std::vector<double> shares;
  double box_cells = 0, shell_fragments = 0;  // of large triangles; the latter under conservative coverage
  std::vector<Sighting> voxels, shell, cells;

  void Add(Sums&& other) {
    fragments += other.fragments;
    squares += other.squares;
    rows += other.rows;
    pairs += other.pairs;
    crossings += other.crossings;
    layers += other.layers;
    area += other.area;
    main += other.main;
    box_cells += other.box_cells;
    shell_fragments += other.shell_fragments;
    for (size_t i = 0; i < shares.size(); ++i) shares[i] += other.shares[i];
    for (auto list : {&Sums::voxels, &Sums::shell, &Sums::cells}) {
      (this->*list).insert((this->*list).end(), (other.*list).begin(), (other.*list).end());
    }
  }
};

class Sampler {
 public:
  Sampler(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid, const JobContext& job)
      : mesh_(mesh), request_(request), grid_(grid), job_(job), space_(grid.index_space()), cells_(grid) {
    for (int i = 0; i < 3; ++i) per_unit_[i] = 1 / grid.voxel_size[i];
    share_layers_ = LayersOfShare(grid);
    const double count = double(mesh.triangle_count);
    rate_ = std::clamp(kSampleOfRoot * std::sqrt(count), kMinSample, kMaxSample) / count;
    covers_ = request.coverage != Coverage::kNone;
    conservative_ = request.coverage == Coverage::kConservative;
  }

  absl::StatusOr<std::optional<Surface>> Run() {
    for (int i = 0; i < 3; ++i) {
      if (!std::isfinite(per_unit_[i])) return std::nullopt;  // of voxels almost as small as numbers can be
    }
    const std::optional<Picked> all_picked = Pick();
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    if (!all_picked || all_picked->sample.size() < kFewSampled) return std::nullopt;
    const Picked& picked = *all_picked;
    const Sums large = Sum(picked.large, [this](const Triangle& t, Sums& sums) { AddLarge(t, sums); });
    if (large.box_cells > kMaxMarks) return std::nullopt;
    if (covers_) Mark(picked.large);
    if (large.fragments > kMaxLayers * double(cells_.edge() * cells_.edge()) * CountMarked() + kFewBoxes) {
      return std::nullopt;
    }
    // Of all the sample's voxels those whose hashes end in zeros, so that they are not too many.
    const double all = double(picked.sample.size()) * AverageOf(picked.sample);
    while (all > kMaxCounted * double(skipped_ + 1)) skipped_ = 2 * skipped_ + 1;
    const Sums small = Sum(picked.sample, [this](const Triangle& t, Sums& sums) { AddSmall(t, sums); });
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    std::optional<Surface> out = Join(picked, large, small);
    if (absl::Status s = job_.Check(); !s.ok()) return s;
    return out;
  }

 private:
  // Of a triangle's box, on average.
  double VoxelsOfBox(uint64_t t, Vec3d& lo, Vec3d& hi) const {
    const uint32_t* const v = mesh_.triangles[t];
    const Vec3d &a = mesh_.positions[v[0]], &b = mesh_.positions[v[1]], &c = mesh_.positions[v[2]];
    double voxels = 1;
    for (int i = 0; i < 3; ++i) {
      lo[i] = Min(a[i], Min(b[i], c[i]));
      hi[i] = Max(a[i], Max(b[i], c[i]));
      voxels *= 1 + (hi[i] - lo[i]) * per_unit_[i];
    }
    return voxels;
  }

  // Absent if too many are large.
  std::optional<Picked> Pick() const {
    const uint64_t count = mesh_.triangle_count;
    Vec3d lo, hi;
    double most = 0;
    for (uint64_t i = 0; i < kPilot; ++i) most += VoxelsOfBox(Scatter(i) % count, lo, hi) / double(kPilot);
    most = std::clamp(kLarger * most, kMinLarge, kMaxSmall);
    const auto limit = uint64_t(rate_ * 0x1p32);
    const bool given = request_.grid.given();  // no other grid has triangles beside it
    Vec3d begin, end;                          // of the grid and a voxel around it
    for (int a = 0; a < 3; ++a) {
      begin[a] = grid_.origin[a] - grid_.voxel_size[a];
      end[a] = grid_.origin[a] + double(grid_.dims[size_t(a)] + 1) * grid_.voxel_size[a];
    }
    const uint64_t most_large = std::min(kMaxLarge, count / kMaxLargeShare);
    std::atomic<uint64_t> large{0};
    std::vector<Picked> parts(size_t((count + kGrain - 1) / kGrain));
    ParallelChunks(int64_t(parts.size()), 1, job_, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last && large.load(std::memory_order_relaxed) <= most_large; ++i) {
        Picked& part = parts[size_t(i)];
        Vec3d low, high;
        for (uint64_t t = uint64_t(i) * kGrain; t < std::min(count, uint64_t(i + 1) * kGrain); ++t) {
          const double voxels = VoxelsOfBox(t, low, high);
          if (given && (low.x > end.x || low.y > end.y || low.z > end.z || high.x < begin.x || high.y < begin.y ||
                        high.z < begin.z)) {
            continue;
          }
          if (!(voxels <= most)) {
            part.large.push_back(t);
            continue;
          }
          ++part.small;
          if ((HashOf(t) >> 32) < limit) part.sample.push_back(t);
        }
        large += part.large.size();
      }
    }).IgnoreError();  // the caller checks the job
    if (large > most_large) return std::nullopt;
    Picked all;
    for (const Picked& part : parts) {
      all.large.insert(all.large.end(), part.large.begin(), part.large.end());
      all.sample.insert(all.sample.end(), part.sample.begin(), part.sample.end());
      all.small += part.small;
    }
    return all;
  }

  template <typename AddTriangle>
  Sums Sum(const std::vector<uint64_t>& triangles, const AddTriangle& add) const {
    Sums none;
    none.shares.resize(size_t((grid_.dims[2] + share_layers_ - 1) / share_layers_));
    return tbb::parallel_deterministic_reduce(
        tbb::blocked_range<size_t>(0, triangles.size(), kGrainOfSample), none,
        [&](const tbb::blocked_range<size_t>& range, Sums part) {
          if (!job_.Check().ok()) return part;
          for (size_t i = range.begin(); i < range.end(); ++i) add(TriangleAt(mesh_, space_, triangles[i]), part);
          return part;
        },
        [](Sums a, Sums b) {
          a.Add(std::move(b));
          return a;
        });
  }

  // What averages say of a triangle; false if it does not touch the grid.
  bool AddTouch(const Triangle& t, Touch& touch, Sums& sums) const {
    const auto [lo, hi] = BoundsOf(t);
    if (!TouchOf(t, lo, hi, grid_, touch)) return false;
    const Vec3d& area = touch.part.area;
    sums.area += area.x + area.y + area.z;
    sums.main += std::max({area.x, area.y, area.z});
    sums.pairs += PairsOf(touch);
    sums.crossings += area.x;
    sums.layers += double(touch.box[2].second - touch.box[2].first + 1);
    return true;
  }

  void AddFragments(const Touch& touch, double fragments, double rows, Sums& sums) const {
    sums.fragments += fragments;
    sums.squares += fragments * fragments;
    sums.rows += rows;
    const int64_t first = touch.box[2].first / share_layers_, last = touch.box[2].second / share_layers_;
    for (int64_t i = first; i <= last; ++i) sums.shares[size_t(i)] += fragments / double(last - first + 1);
  }

  void AddLarge(const Triangle& t, Sums& sums) const {
    Touch touch;
    if (!AddTouch(t, touch, sums) || !covers_) return;
    const Vec3d& area = touch.part.area;
    const double areas = area.x + area.y + area.z;
    const double kept = conservative_ || !(areas > 0) ? 1 : std::max({area.x, area.y, area.z}) / areas;
    AddFragments(touch, kept * touch.fragments, touch.rows, sums);
    sums.box_cells += Count(cells_.CellsOf(touch.box));
    sums.shell_fragments += touch.fragments;
  }

  void AddSmall(const Triangle& t, Sums& sums) const {
    Touch touch;
    if (!AddTouch(t, touch, sums) || !covers_) return;
    double fragments = 0, rows = 0;
    const size_t first_voxel = sums.voxels.size(), first_shell = sums.shell.size(), first_cell = sums.cells.size();
    const auto see = [&](std::vector<Sighting>& seen, int64_t y, int64_t z, int64_t begin, int64_t end) {
      const uint64_t row = uint64_t(grid_.dims[0]) * (uint64_t(y) + uint64_t(grid_.dims[1]) * uint64_t(z));
      for (uint64_t voxel = row + uint64_t(begin); voxel < row + uint64_t(end); ++voxel) {
        if ((HashOf(voxel) & skipped_) == 0) seen.push_back({voxel});
      }
    };
    const VoxelRange range = RangeOf(touch.box);
    ForEachRowSpan(SetUpTriangle(t.a, t.b, t.c, request_.coverage), range,
                   [&](int64_t y, int64_t z, int64_t begin, int64_t end) {
                     fragments += double(end - begin);
                     rows += double((end - 1) / TileDim(0) - begin / TileDim(0) + 1);
                     see(sums.voxels, y, z, begin, end);
                   });
    if (HasSeparateShell(request_)) {
      ForEachRowSpan(SetUpTriangle(t.a, t.b, t.c, Coverage::kConservative), range,
                     [&](int64_t y, int64_t z, int64_t begin, int64_t end) { see(sums.shell, y, z, begin, end); });
    }
    AddFragments(touch, fragments, rows, sums);
    cells_.ForEach(t, touch.box, [&](int64_t x, int64_t y, int64_t z) {
      const int64_t cell = x + cells_.dim(0) * (y + cells_.dim(1) * z);
      if (!cells_.at(cell)) sums.cells.push_back({uint64_t(cell)});
    });
    const double area = touch.part.area.x + touch.part.area.y + touch.part.area.z;
    for (auto [seen, first] : {std::pair(&sums.voxels, first_voxel), std::pair(&sums.shell, first_shell),
                               std::pair(&sums.cells, first_cell)}) {
      for (size_t i = first; i < seen->size(); ++i) (*seen)[i].area = area / double(seen->size() - first);
    }
  }

  void Mark(const std::vector<uint64_t>& large) {
    ParallelChunks(int64_t(large.size()), kGrainOfSample, job_, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        const Triangle t = TriangleAt(mesh_, space_, large[size_t(i)]);
        const auto [lo, hi] = BoundsOf(t);
        Box box;
        if (!VoxelsOf(lo, hi, grid_, box)) continue;
        cells_.ForEach(t, box, [&](int64_t x, int64_t y, int64_t z) { cells_.Mark(x, y, z); });
      }
    }).IgnoreError();  // the caller checks the job
  }

  double CountMarked() const {
    uint64_t marked = 0;
    for (int64_t w = 0; w < cells_.words(); ++w) marked += uint64_t(std::popcount(cells_.word(w)));
    return double(marked);
  }

  // The fragments of conservative coverage of a triangle, on average.
  double AverageOf(const std::vector<uint64_t>& sample) const {
    double fragments = 0;
    for (uint64_t i = 0; i < kFewSampled; ++i) {
      const Triangle t = TriangleAt(mesh_, space_, sample[i * sample.size() / kFewSampled]);
      const auto [lo, hi] = BoundsOf(t);
      Touch touch;
      if (TouchOf(t, lo, hi, grid_, touch)) fragments += touch.fragments / double(kFewSampled);
    }
    return fragments;
  }

  // How many places the small triangles touch; absent where the sample cannot tell. In: those that it saw, as often as
  // it did, with bits that are zero in all their hashes; how many a surface of their area touches; how many they touch
  // one by one; how many large ones touch. Sets `places`.
  std::optional<double> PlacesOf(const std::vector<Sighting>& seen, double of_area, double of_each, double large,
                                 Sightings& places) const {
    for (const Sighting& sighting : seen) places.Add(sighting);
    const auto [least, most, bound] = places.Estimate(rate_, of_area, of_each);
    const double known = large + kFewBoxes;
    if (known + bound > kMaxBoundRatio * (known + most)) return std::nullopt;
    const double low = (least + most) / 2;
    return std::min(of_each, std::clamp(bound, low, kMaxTakenRatio * low));
  }

  std::optional<Surface> Join(const Picked& picked, const Sums& large, const Sums& small) const {
    const double sampled = double(picked.sample.size()), weight = double(picked.small) / sampled;
    // Two standard errors more than the sample's average.
    const double mean = small.fragments / sampled, variance = std::max(0.0, small.squares / sampled - mean * mean);
    const double more = weight * (mean > 0 ? 1 + 2 * std::sqrt(variance / sampled) / mean : 1);
    const double all = double(grid_.voxels());
    Surface out;
    out.share_layers = share_layers_;
    out.doubt = kDoubtOfSample;
    out.crossings = large.crossings + weight * small.crossings;
    out.layers = large.layers + weight * small.layers;
    double shell = 0;
    if (covers_) {
      out.fragments = large.fragments + more * small.fragments;
      out.rows = std::min(out.fragments, large.rows + more * small.rows);
      out.pairs = large.pairs + weight * small.pairs;
      for (size_t i = 0; i < large.shares.size(); ++i) {
        out.shares.push_back({large.shares[i] + more * small.shares[i], 0});
      }
      if (!CountBricks(weight, small, out)) return std::nullopt;
      const double area = kOfArea * weight * (conservative_ ? small.area : small.main) + kFewBoxes;
      Sightings voxels(skipped_);
      const auto covered = PlacesOf(small.voxels, area, more * small.fragments, large.fragments, voxels);
      if (!covered) return std::nullopt;
      // Triangles that lie apart have a brick each and may have no area: beside few voxels that have most of the
      // triangles, the voxels say nothing of them.
      const double places = large.fragments + *covered + kFewBoxes;
      if (std::min(out.fragments, places + out.bricks) > kMaxBoundRatio * places) return std::nullopt;
      out.voxels = std::min({large.fragments + *covered, all, 512 * out.bricks});
      out.tiles = std::min(out.pairs, out.bricks);
      shell = out.voxels;
      if (HasSeparateShell(request_)) {
        Sightings touched(skipped_);
        const double each = weight * double(small.shell.size()) * double(skipped_ + 1);
        const double of_area = kOfArea * weight * small.area + kFewBoxes;
        const auto of_shell = PlacesOf(small.shell, of_area, each, large.shell_fragments, touched);
        if (!of_shell) return std::nullopt;
        shell = std::min(all, large.shell_fragments + *of_shell);
      }
    }
    out.filled_bricks = out.bricks;
    if (request_.fill != Fill::kNone) CountFilled(mesh_, request_, grid_, job_, shell, cells_, out);
    return out;
  }

  // False where the sample cannot tell.
  bool CountBricks(double weight, const Sums& small, Surface& out) const {
    const double bricks_of_cell = BricksOfCell(cells_);
    const auto edge = double(cells_.edge());
    const auto add = [&](uint64_t cell, double bricks) {
      const int64_t layer = int64_t(cell) / (cells_.dim(0) * cells_.dim(1)) * cells_.edge();
      out.shares[size_t(layer / share_layers_)].bricks += bricks;
      out.bricks += bricks;
    };
    for (int64_t w = 0; w < cells_.words(); ++w) {
      for (uint64_t left = cells_.word(w); left != 0; left &= left - 1) {
        add(uint64_t(w * 64 + std::countr_zero(left)), bricks_of_cell);
      }
    }
    Sightings places(0);
    const double of_area = kOfArea * weight * small.area / (edge * edge) + kFewBoxes;
    const auto cells = PlacesOf(small.cells, of_area, weight * double(small.cells.size()), CountMarked(), places);
    if (!cells) return false;
    double kept = 0;
    places.ForEachKept([&](uint64_t) { ++kept; });
    places.ForEachKept([&](uint64_t cell) { add(cell, *cells / kept * bricks_of_cell); });
    const double most = double(grid_.voxels()) / 512 + 1;
    out.bricks = std::min({out.bricks, double(cells_.count()) * bricks_of_cell, cells_.edge() > 8 ? most : out.bricks});
    return true;
  }

  const MeshView& mesh_;
  const VoxelizeRequest& request_;
  const GridSpec& grid_;
  const JobContext& job_;
  const IndexSpace space_;
  Vec3d per_unit_;  // voxels a world unit
  Cells cells_;     // marked: touched by large triangles
  int64_t share_layers_;
  double rate_;           // of small triangles that are sampled
  uint64_t skipped_ = 0;  // bits of a voxel's hash, one less than a power of two
  bool covers_, conservative_;
};

}  // namespace

absl::StatusOr<std::optional<Surface>> SampleLists(const MeshView& mesh, const VoxelizeRequest& request,
                                                   const GridSpec& grid, const JobContext& job) {
  return Sampler(mesh, request, grid, job).Run();
}

}  // namespace voxelpipe
