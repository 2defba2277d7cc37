#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "absl/strings/str_cat.h"
#include "fuzz/fuzz_checks.h"

namespace voxelpipe::fuzz {
namespace {

using Real = long double;

// Exactly one end has y <= py, and the edge passes above pz there: in double, the ends in order of (y, z).
bool PassesAbove(Vec3d p, Vec3d q, double py, double pz) {
  if (q.y < p.y || (q.y == p.y && q.z < p.z)) std::swap(p, q);
  if ((p.y <= py) == (q.y <= py)) return false;
  return (q.y - p.y) * (pz - p.z) < (q.z - p.z) * (py - p.y);
}

// The sum over a triangle's edges that are crossed, +1 where y rises along the edge.
int SignOf(const IndexTriangle& t, double py, double pz) {
  int sum = 0;
  for (int i = 0; i < 3; ++i) {
    const Vec3d &p = t.v[i], &q = t.v[(i + 1) % 3];
    if (PassesAbove(p, q, py, pz)) sum += p.y < q.y ? 1 : -1;
  }
  return sum;
}

struct Crossing {
  Real least, most;  // x lies within; rounding decides where
  int sign = 0;
};

Crossing CrossingOf(const IndexTriangle& t, double py, double pz) {
  Vec3<Real> v[3];
  for (int i = 0; i < 3; ++i) v[i] = {t.v[i].x, t.v[i].y, t.v[i].z};
  const Real lo = std::min({v[0].x, v[1].x, v[2].x}), hi = std::max({v[0].x, v[1].x, v[2].x});
  const Vec3<Real> e1 = v[1] - v[0], e2 = v[2] - v[0], n = Cross(e1, e2);
  Real extent = 1e-300L;
  for (int a = 0; a < 3; ++a) extent = std::max({extent, std::fabs(e1[a]), std::fabs(e2[a])});
  const Real unsure = 1e-9L + std::fabs(v[0].x) * 0x1p-50L + extent * extent * extent * 0x1p-44L / std::fabs(n.x);
  const int sign = SignOf(t, py, pz);
  if (!(unsure < hi - lo + 1)) return {lo - 1e-9L, hi + 1e-9L, sign};
  const Real x = v[0].x - (n.y * (py - v[0].y) + n.z * (pz - v[0].z)) / n.x;
  return {std::clamp(x - unsure, lo, hi) - 1e-9L, std::clamp(x + unsure, lo, hi) + 1e-9L, sign};
}

}  // namespace

std::string CheckCrossings(Fill fill, const std::vector<IndexTriangle>& triangles, const GridSpec& grid,
                           const VoxelFlags& covered, const VoxelFlags& filled, uint64_t odd_columns) {
  const std::string what(Name(fill));
  // Of crossings beyond a voxel, or of all: whether they leave it inside.
  const auto is_inside = [&](int64_t count, int64_t sum) { return fill == Fill::kNonzero ? sum != 0 : count % 2 != 0; };
  uint64_t odd = 0;
  for (int64_t k = 0; k < grid.dims[2]; ++k) {
    for (int64_t j = 0; j < grid.dims[1]; ++j) {
      const double py = double(j) + 0.5, pz = double(k) + 0.5;
      std::vector<Crossing> crossings;
      for (const IndexTriangle& t : triangles) {
        int above = 0;
        for (int i = 0; i < 3; ++i) above += PassesAbove(t.v[i], t.v[(i + 1) % 3], py, pz);
        if (above % 2 == 1) crossings.push_back(CrossingOf(t, py, pz));
      }
      int64_t total = 0;
      for (const Crossing& c : crossings) total += c.sign;
      odd += is_inside(int64_t(crossings.size()), total);
      for (int64_t i = 0; i < grid.dims[0]; ++i) {
        const auto n = size_t(i + grid.dims[0] * (j + grid.dims[1] * k));
        const Real centre = Real(i) + 0.5L;
        bool unsure = false;
        int64_t count = 0, sum = 0;
        for (const Crossing& c : crossings) {
          unsure = unsure || (c.least <= centre && centre <= c.most);
          if (c.least <= centre) continue;
          ++count;
          sum += c.sign;
        }
        const bool inside = is_inside(count, sum);
        if (!unsure && bool(filled[n]) != (inside || covered[n] != 0)) {
          return absl::StrCat(what, ": voxel (", i, ",", j, ",", k, ") is ", int(filled[n]), "\n");
        }
        if (unsure && covered[n] > filled[n]) return absl::StrCat(what, ": voxel ", n, " is covered and not set\n");
      }
    }
  }
  if (odd == odd_columns) return "";
  return absl::StrCat(what, ": odd_columns is ", odd_columns, ", reference says ", odd, "\n");
}

std::string CheckFlood(const GridSpec& grid, const VoxelFlags& shell, const VoxelFlags& covered,
                       const VoxelFlags& filled) {
  const int64_t nx = grid.dims[0] + 2, ny = grid.dims[1] + 2, nz = grid.dims[2] + 2;  // with the layer around the grid
  VoxelFlags reached(size_t(nx * ny * nz), 0);
  std::deque<std::array<int64_t, 3>> queue{{0, 0, 0}};
  reached[0] = 1;
  const auto index = [&](int64_t x, int64_t y, int64_t z) {
    return size_t((x - 1) + grid.dims[0] * ((y - 1) + grid.dims[1] * (z - 1)));
  };
  const auto inside_grid = [&](int64_t x, int64_t y, int64_t z) {
    return x > 0 && y > 0 && z > 0 && x < nx - 1 && y < ny - 1 && z < nz - 1;
  };
  while (!queue.empty()) {
    const auto v = queue.front();
    queue.pop_front();
    for (int side = 0; side < 6; ++side) {
      auto w = v;
      w[size_t(side / 2)] += side % 2 == 0 ? 1 : -1;
      const auto [x, y, z] = w;
      if (x < 0 || y < 0 || z < 0 || x >= nx || y >= ny || z >= nz) continue;
      uint8_t& seen = reached[size_t(x + nx * (y + ny * z))];
      if (seen != 0 || (inside_grid(x, y, z) && shell[index(x, y, z)] != 0)) continue;
      seen = 1;
      queue.push_back(w);
    }
  }
  for (int64_t z = 1; z < nz - 1; ++z) {
    for (int64_t y = 1; y < ny - 1; ++y) {
      for (int64_t x = 1; x < nx - 1; ++x) {
        const size_t n = index(x, y, z);
        const bool expected = covered[n] != 0 || reached[size_t(x + nx * (y + ny * z))] == 0;
        if (bool(filled[n]) != expected) return absl::StrCat("flood: voxel ", n, " is ", int(filled[n]), "\n");
      }
    }
  }
  return "";
}

}  // namespace voxelpipe::fuzz
