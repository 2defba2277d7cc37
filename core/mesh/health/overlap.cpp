// Source: the crossing and winding rules of the fills (raster/crossing.h), on a uniform grid over y and z as in
// A. Fujimoto, T. Tanaka, K. Iwata, "ARTS: Accelerated Ray-Tracing System", 1986.
#include "mesh/health/overlap.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string_view>
#include <utility>

#include "base/long_loops.h"
#include "mesh/health/shells.h"
#include "raster/crossing.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kTestsEach = 256, kTestsMore = 1 << 24;

// Polls a job between steps of about the same amount of work.
class Polls {
 public:
  explicit Polls(const JobContext& job) : job_(job) {}
  // True if the job ended. `work`: the elements since the last call.
  bool Ended(uint64_t work) {
    done_ += work;
    if (ended_ || done_ < kElementsAStep) return ended_;
    done_ = 0;
    return ended_ = !job_.Check().ok();
  }

 private:
  const JobContext& job_;
  uint64_t done_ = 0;
  bool ended_ = false;
};

// The triangles of the closed shells, listed for each cell of a grid over y and z that a triangle's box touches.
class Columns {
 public:
  // In: the number of triangles of closed shells, at least 1. If the job ended, the lists are incomplete.
  Columns(const JobContext& job, const TriangleMesh& mesh, const ShellList& list, uint64_t triangles, Polls& polls)
      : mesh_(mesh), list_(list), polls_(polls) {
    constexpr double kMaxCells = 2048;  // an axis
    bool first = true;
    Vec3d max{};
    for (const Shell& shell : list.shells) {
      if (polls_.Ended(1)) return;
      if (!shell.closed) continue;
      for (int a = 0; a < 3; ++a) {
        min_[a] = first ? shell.min[a] : Min(min_[a], shell.min[a]);
        max[a] = first ? shell.max[a] : Max(max[a], shell.max[a]);
      }
      first = false;
    }
    for (cells_ = int64_t(Clamp(std::sqrt(double(triangles)), 1.0, kMaxCells));; cells_ /= 2) {
      for (int a = 0; a < 3; ++a) {
        const double size = max[a] - min_[a];
        scale_[a] = size > 0 ? double(cells_) / size : 1.0;
      }
      // One cell an axis takes each triangle once.
      if (cells_ == 1 || CountEntries() <= 8 * triangles) break;
    }
    begin_.assign(size_t(cells_ * cells_) + 1, 0);
    if (polls_.Ended(0)) return;
    ForEachEntry([&](size_t cell, uint32_t) { ++begin_[cell + 1]; });
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    if (!Resize(job, triangles_, begin_.back()).ok()) return;
    std::vector<uint32_t> next(begin_.begin(), begin_.end() - 1);
    ForEachEntry([&](size_t cell, uint32_t t) { triangles_[next[cell]++] = t; });
  }

  // To the grid's coordinates, in which positions are small and equal ones stay equal.
  Vec3d Place(const Vec3d& p) const {
    return {(p.x - min_.x) * scale_.x, (p.y - min_.y) * scale_.y, (p.z - min_.z) * scale_.z};
  }

  // Calls hit(shell, sign) for each crossing of the line from `p` (placed) towards +x; sign is +1 where it leaves a
  // shell that faces outward. Returns the number of triangles tested. If the job ended, some crossings are missing.
  template <typename Hit>
  uint64_t Cast(const Vec3d& p, uint32_t own, const Hit& hit) const {
    const size_t cell = CellOf(p.y, p.z);
    for (uint32_t e = begin_[cell]; e < begin_[cell + 1]; ++e) {
      if (polls_.Ended(1)) break;
      const uint32_t t = triangles_[e];
      if (list_.shell_of[t] == own) continue;
      const Vec3d a = Corner(t, 0), b = Corner(t, 1), c = Corner(t, 2);
      if (!LineCrosses(a, b, c, p.y, p.z)) continue;
      if (CrossingX(SetUpPlane(a, b, c), a, b, c, p.y, p.z) <= p.x) continue;
      hit(list_.shell_of[t], CrossingFalls(a, b, c, p.y, p.z) ? 1 : -1);
    }
    return begin_[cell + 1] - begin_[cell];
  }

 private:
  Vec3d Corner(uint32_t t, size_t i) const { return Place(mesh_.positions[mesh_.triangles[t][i]]); }
  int64_t Clamped(double at) const { return int64_t(Clamp(std::floor(at), 0.0, double(cells_ - 1))); }
  size_t CellOf(double y, double z) const { return size_t(Clamped(z) * cells_ + Clamped(y)); }

  // Calls box(t, y0, y1, z0, z1) for each triangle with its inclusive range of cells.
  template <typename Box>
  void ForEachBox(const Box& box) const {
    for (uint32_t t = 0; t < mesh_.triangles.size() && !polls_.Ended(1); ++t) {
      if (list_.shell_of[t] == kNoShell || !list_.shells[list_.shell_of[t]].closed) continue;
      const Vec3d a = Corner(t, 0), b = Corner(t, 1), c = Corner(t, 2);
      box(t, Clamped(Min(a.y, Min(b.y, c.y))), Clamped(Max(a.y, Max(b.y, c.y))), Clamped(Min(a.z, Min(b.z, c.z))),
          Clamped(Max(a.z, Max(b.z, c.z))));
    }
  }
  uint64_t CountEntries() const {
    uint64_t count = 0;
    ForEachBox([&](uint32_t, int64_t y0, int64_t y1, int64_t z0, int64_t z1) {
      count += uint64_t(y1 - y0 + 1) * uint64_t(z1 - z0 + 1);
    });
    return count;
  }
  template <typename Entry>
  void ForEachEntry(const Entry& entry) const {
    ForEachBox([&](uint32_t t, int64_t y0, int64_t y1, int64_t z0, int64_t z1) {
      for (int64_t z = z0; z <= z1 && !polls_.Ended(uint64_t(y1 - y0 + 1)); ++z) {
        for (int64_t y = y0; y <= y1; ++y) entry(size_t(z * cells_ + y), t);
      }
    });
  }

  const TriangleMesh& mesh_;
  const ShellList& list_;
  Polls& polls_;
  Vec3d min_{}, scale_{};
  int64_t cells_ = 1;                // of each of the two axes
  std::vector<uint32_t> begin_;      // of each cell in triangles_, and the end of the last
  std::vector<uint32_t> triangles_;  // ascending in each cell
};

struct Samples {
  uint32_t taken = 0, inside = 0;
  uint64_t seen_triangles = 0;
  int winding = 0;  // of all shells around the first sample
  bool boxes = false, undecided = false;
};

// Samples all closed shells. Sets `undecided` on those for which no tests are left.
class Sampler {
 public:
  Sampler(const JobContext& job, const TriangleMesh& mesh, const ShellList& list, uint64_t triangles)
      : job_(job),
        mesh_(mesh),
        list_(list),
        polls_(job),
        columns_(job, mesh, list, triangles, polls_),
        tests_left_(kTestsEach * triangles + kTestsMore) {}

  absl::Status Run(std::vector<Samples>& samples) {
    if (absl::Status over = job_.Check(); !over.ok()) return over;  // the columns are incomplete
    // One sample of each shell first, so that a few large shells do not use up the tests.
    for (uint32_t s = 0; s < samples.size(); ++s) {
      if (polls_.Ended(1)) return job_.Check();
      if (list_.shells[s].closed) Take(s, list_.shells[s].first_triangle, 0, samples[s]);
    }
    std::vector<uint8_t> taken;
    if (absl::Status over = Resize(job_, taken, mesh_.positions.size()); !over.ok()) return over;
    for (uint32_t t = 0; t < mesh_.triangles.size(); ++t) {
      if (polls_.Ended(1)) return job_.Check();
      const uint32_t s = list_.shell_of[t];
      if (s == kNoShell || !list_.shells[s].closed) continue;
      constexpr uint64_t kSampledTriangles = 256;
      const uint64_t step = (list_.shells[s].triangles + kSampledTriangles - 1) / kSampledTriangles;
      if (samples[s].seen_triangles++ % step != 0) continue;
      for (size_t i = 0; i < 3; ++i) {
        if (uint8_t& done = taken[mesh_.triangles[t][i]]; done == 0) {
          done = 1;
          Take(s, t, i, samples[s]);
        }
      }
    }
    return job_.Check();
  }

 private:
  void Take(uint32_t s, uint32_t t, size_t corner, Samples& samples) {
    if (tests_left_ == 0) {
      samples.undecided = true;
      return;
    }
    constexpr double kInward = 1e-6;
    const Shell& shell = list_.shells[s];
    Vec3d p = mesh_.positions[mesh_.triangles[t][corner]];
    for (int a = 0; a < 3; ++a) p[a] += kInward * ((shell.min[a] / 2 + shell.max[a] / 2) - p[a]);
    hits_.clear();
    const uint64_t tests =
        columns_.Cast(columns_.Place(p), s, [&](uint32_t other, int sign) { hits_.emplace_back(other, sign); });
    tests_left_ -= std::min(tests_left_, tests + 1);
    if (!ParallelSort(job_, hits_).ok()) return;  // the caller polls
    bool inside = false;
    int sum = 0;
    for (size_t begin = 0, end = 0; begin < hits_.size(); begin = end) {
      int winding = 0;
      for (; end < hits_.size() && hits_[end].first == hits_[begin].first; ++end) winding += hits_[end].second;
      inside = inside || (list_.shells[hits_[begin].first].oriented ? winding != 0 : (end - begin) % 2 == 1);
      sum += winding;
    }
    if (samples.taken == 0) samples.winding = sum;
    ++samples.taken;
    samples.inside += inside;
  }

  const JobContext& job_;
  const TriangleMesh& mesh_;
  const ShellList& list_;
  Polls polls_;
  Columns columns_;
  uint64_t tests_left_;
  std::vector<std::pair<uint32_t, int>> hits_;  // of one sample: shell and sign
};

bool BoxesOverlap(const Shell& a, const Shell& b) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(a.min[axis] < b.max[axis] && b.min[axis] < a.max[axis])) return false;
  }
  return true;
}

// Sets `boxes` on both shells of each pair of which no sample lies inside another: a sweep along x.
absl::Status FindBoxPairs(const JobContext& job, const ShellList& list, std::vector<Samples>& samples) {
  std::vector<uint32_t> order, active;
  absl::Status over = InSteps(job, samples.size(), [&](uint64_t begin, uint64_t end) {
    for (uint32_t s = uint32_t(begin); s < end; ++s) {
      if (list.shells[s].closed && samples[s].inside == 0) order.push_back(s);
    }
  });
  if (!over.ok()) return over;
  over = ParallelSort(job, order, [&](uint32_t a, uint32_t b) {
    const double x = list.shells[a].min.x, y = list.shells[b].min.x;
    return x < y || (x == y && a < b);
  });
  if (!over.ok()) return over;
  uint64_t tests_left = kTestsEach * order.size() + kTestsMore;
  Polls polls(job);
  for (size_t i = 0; i < order.size(); ++i) {
    if (polls.Ended(1 + active.size())) return job.Check();
    const Shell& shell = list.shells[order[i]];
    if (active.size() > tests_left) {
      for (; i < order.size(); ++i) samples[order[i]].undecided |= !samples[order[i]].boxes;
      break;
    }
    tests_left -= active.size();
    std::erase_if(active, [&](uint32_t s) { return list.shells[s].max.x <= shell.min.x; });
    for (const uint32_t s : active) {
      if (BoxesOverlap(list.shells[s], shell)) samples[s].boxes = samples[order[i]].boxes = true;
    }
    active.push_back(order[i]);
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<OverlapCounts> FindOverlaps(const JobContext& job, const TriangleMesh& mesh, const ShellList& list) {
  uint64_t closed = 0, triangles = 0;
  absl::Status over = InSteps(job, list.shells.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t s = begin; s < end; ++s) {
      const Shell& shell = list.shells[s];
      closed += shell.closed;
      triangles += shell.closed ? shell.triangles : 0;
    }
  });
  if (!over.ok()) return over;
  OverlapCounts counts;
  if (closed < 2) return counts;
  MemoryCharge charge(&MemoryOf(job));
  constexpr uint64_t kTriangleBytes = 48, kShellBytes = sizeof(Samples) + 2 * sizeof(uint32_t);
  constexpr std::string_view kWhat = "the shells of the mesh";
  if (absl::Status full = charge.Grow(triangles, kTriangleBytes, kWhat); !full.ok()) return full;
  if (absl::Status full = charge.Grow(list.shells.size(), kShellBytes, kWhat); !full.ok()) return full;
  if (absl::Status full = charge.Grow(mesh.positions.size(), kWhat); !full.ok()) return full;
  std::vector<Samples> samples;
  if (over = Resize(job, samples, list.shells.size()); !over.ok()) return over;
  if (over = Sampler(job, mesh, list, triangles).Run(samples); !over.ok()) return over;
  if (over = FindBoxPairs(job, list, samples); !over.ok()) return over;
  const auto count = [&](size_t s) {
    const Samples& own = samples[s];
    if (own.inside > 0 && own.inside == own.taken && !own.undecided) {
      ++counts.nested;
      counts.cavities += IsFlipped(list.shells[s]) && own.winding > 0;
    } else if (own.inside > 0) {
      ++counts.overlapping;
    } else if (own.boxes) {
      ++counts.boxes_only;
    } else if (own.undecided) {
      ++counts.undecided;
    }
  };
  over = InSteps(job, samples.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t s = begin; s < end; ++s) count(s);
  });
  if (!over.ok()) return over;
  return counts;
}

}  // namespace voxelpipe
