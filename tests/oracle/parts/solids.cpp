// Who contains which centre.
#include <algorithm>
#include <cmath>

#include "oracle/parts/parts_reference.h"
#include "support/reference/reference.h"

namespace voxelpipe::testing {
namespace {

constexpr double kNear = 1e-6;  // voxels

struct Bounds {
  Vec3d low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};
  void Add(const Vec3d& p) {
    for (int a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], p[a] - kNear);
      high[a] = std::max(high[a], p[a] + kNear);
    }
  }
  bool Has(const Vec3d& p) const {
    for (int a = 0; a < 3; ++a) {
      if (p[a] < low[a] || p[a] > high[a]) return false;
    }
    return true;
  }
};

// Distance of a point of the plane x = 0 to an edge that is seen along x.
double DistanceAlongX(const Vec3d& a, const Vec3d& b, double y, double z) {
  const double ey = b.y - a.y, ez = b.z - a.z, length = ey * ey + ez * ez;
  const double t = length > 0 ? std::clamp(((y - a.y) * ey + (z - a.z) * ez) / length, 0.0, 1.0) : 0;
  return std::hypot(y - (a.y + t * ey), z - (a.z + t * ez));
}

// A column and a triangle.
struct Crossing {
  bool crosses = false, near_edge = false;
  int sign = 0;
  double x = 0;
  double low = 0, high = 0;  // of the triangle
};

Crossing Meet(const Vec3d (&v)[3], double y, double z) {
  Crossing found;
  for (int e = 0; e < 3; ++e) {
    const Vec3d &from = v[e], &to = v[(e + 1) % 3];
    found.near_edge = found.near_edge || DistanceAlongX(from, to, y, z) < kNear;
    if ((from.y <= y) == (to.y <= y)) continue;
    // Where the edge is at y, beside the point: the half line towards +z crosses it, or not. From the lower end, so
    // that both faces of an edge see the same.
    const Vec3d &a = from.y < to.y ? from : to, &b = from.y < to.y ? to : from;
    const long double t = (static_cast<long double>(y) - a.y) / (static_cast<long double>(b.y) - a.y);
    if (a.z + t * (static_cast<long double>(b.z) - a.z) <= z) continue;
    found.crosses = !found.crosses;
    found.sign += to.y > from.y ? 1 : -1;
  }
  found.low = std::min({v[0].x, v[1].x, v[2].x});
  found.high = std::max({v[0].x, v[1].x, v[2].x});
  if (!found.crosses) return found;
  const Vec3d n = Cross(v[1] - v[0], v[2] - v[0]);
  const double x = n.x == 0 ? found.low : v[0].x - (n.y * (y - v[0].y) + n.z * (z - v[0].z)) / n.x;
  found.x = std::clamp(x, found.low, found.high);
  return found;
}

}  // namespace

Solids::Solids(const Assembly& assembly, const GridSpec& grid)
    : assembly_(assembly), grid_(grid), winding_(assembly.bodies.size()), near_(assembly.bodies.size()) {
  for (size_t b = 0; b < assembly.bodies.size(); ++b) {
    std::vector<Vec3d>& positions = positions_.emplace_back(assembly.bodies[b].body.positions);
    for (Vec3d& p : positions) {
      for (int a = 0; a < 3; ++a) p[a] = (p[a] - grid.origin[a]) / grid.voxel_size[a];
    }
    if (assembly.bodies[b].body.closed) Wind(b);
  }
}

void Solids::Wind(size_t body) {
  const auto& triangles = assembly_.bodies[body].body.triangles;
  const std::vector<Vec3d>& positions = positions_[body];
  winding_[body].resize(grid_.voxels());
  near_[body].resize(grid_.voxels());
  Bounds all;
  std::vector<Bounds> of_each(triangles.size());
  for (size_t t = 0; t < triangles.size(); ++t) {
    for (const uint32_t v : triangles[t]) {
      all.Add(positions[v]);
      of_each[t].Add(positions[v]);
    }
  }
  uint64_t n = 0;
  for (int64_t z = 0; z < grid_.dims[2]; ++z) {
    for (int64_t y = 0; y < grid_.dims[1]; ++y) {
      for (int64_t x = 0; x < grid_.dims[0]; ++x, ++n) {
        const Vec3d centre{double(x) + 0.5, double(y) + 0.5, double(z) + 0.5};
        if (!all.Has(centre)) continue;
        for (size_t t = 0; t < triangles.size() && !near_[body][n]; ++t) {
          const auto& v = triangles[t];
          near_[body][n] =
              of_each[t].Has(centre) && Distance(centre, positions[v[0]], positions[v[1]], positions[v[2]]) < kNear;
        }
        if (!near_[body][n]) winding_[body][n] = int8_t(WindingNumber(positions, triangles, centre));
      }
    }
  }
}

std::vector<Inside> Solids::Of(const std::vector<size_t>& bodies, Fill fill) const {
  if (std::any_of(bodies.begin(), bodies.end(), [&](size_t b) { return !assembly_.bodies[b].body.closed; })) {
    return ByCrossings(bodies, fill);
  }
  std::vector<Inside> inside(grid_.voxels());
  for (uint64_t n = 0; n < inside.size(); ++n) {
    int sum = 0;
    bool near = false;
    for (const size_t b : bodies) {
      sum += winding_[b][n];
      near = near || near_[b][n];
    }
    const bool in = fill == Fill::kParity ? sum % 2 != 0 : sum != 0;
    inside[n] = near ? Inside::kUnsure : in ? Inside::kYes : Inside::kNo;
  }
  return inside;
}

std::vector<Inside> Solids::ByCrossings(const std::vector<size_t>& bodies, Fill fill, uint64_t* odd,
                                        uint64_t* maybe_odd) const {
  std::vector<Inside> inside(grid_.voxels());
  const int64_t nx = grid_.dims[0];
  for (int64_t k = 0; k < grid_.dims[2]; ++k) {
    for (int64_t j = 0; j < grid_.dims[1]; ++j) {
      const double y = double(j) + 0.5, z = double(k) + 0.5;
      std::vector<Crossing> crossings;
      bool unsure = false;
      int total = 0;
      for (const size_t b : bodies) {
        for (const auto& t : assembly_.bodies[b].body.triangles) {
          const Vec3d v[] = {positions_[b][t[0]], positions_[b][t[1]], positions_[b][t[2]]};
          const Crossing crossing = Meet(v, y, z);
          // Beside an edge of a closed body its other face takes over; only centres at the face itself are unsure.
          unsure = unsure || (crossing.near_edge && !assembly_.bodies[b].body.closed);
          if (crossing.near_edge || crossing.crosses) crossings.push_back(crossing);
          if (!crossing.crosses) continue;
          total += fill == Fill::kParity ? 1 : crossing.sign;
        }
      }
      const bool is_odd = fill == Fill::kParity ? total % 2 != 0 : total != 0;
      if (odd != nullptr && is_odd && !unsure) ++*odd;
      if (maybe_odd != nullptr && unsure) ++*maybe_odd;
      for (int64_t i = 0; i < nx; ++i) {
        const double centre = double(i) + 0.5;
        Inside& of = inside[uint64_t(i + nx * (j + grid_.dims[1] * k))];
        int sum = 0;
        bool near = unsure;
        for (const Crossing& crossing : crossings) {
          if (crossing.crosses && centre < crossing.x) sum += fill == Fill::kParity ? 1 : crossing.sign;
          near = near || (crossing.crosses && std::abs(centre - crossing.x) < kNear);
          near = near || (crossing.near_edge && centre > crossing.low - kNear && centre < crossing.high + kNear);
        }
        const bool in = fill == Fill::kParity ? sum % 2 != 0 : sum != 0;
        of = near ? Inside::kUnsure : in ? Inside::kYes : Inside::kNo;
      }
    }
  }
  return inside;
}

}  // namespace voxelpipe::testing
