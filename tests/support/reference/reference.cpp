#include "support/reference/reference.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace voxelpipe::testing {
namespace {

using Real = long double;
using Point = Vec3<Real>;

Point ToReal(const Vec3d& v) {
  return {v.x, v.y, v.z};
}

// Clips a polygon by sign * (p[axis] - at) <= 0.
std::vector<Point> Clip(const std::vector<Point>& polygon, int axis, Real at, Real sign) {
  std::vector<Point> kept;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const Point &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
    const Real dp = sign * (p[axis] - at), dq = sign * (q[axis] - at);
    if (dp <= 0) kept.push_back(p);
    if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) {
      const Real t = dp / (dp - dq);
      Point cut = p + (q - p) * t;
      cut[axis] = at;
      kept.push_back(cut);
    }
  }
  return kept;
}

// True if the triangle meets the closed box centre +- half (a negative half size is an empty box).
bool MeetsBox(const Point (&v)[3], const Point& centre, const Point& half) {
  std::vector<Point> polygon(v, v + 3);
  for (int axis = 0; axis < 3; ++axis) {
    if (half[axis] < 0) return false;
    polygon = Clip(polygon, axis, centre[axis] + half[axis], 1);
    if (polygon.empty()) return false;
    polygon = Clip(polygon, axis, centre[axis] - half[axis], -1);
    if (polygon.empty()) return false;
  }
  return true;
}

}  // namespace

bool Touches(const Vec3d& a, const Vec3d& b, const Vec3d& c, int64_t x, int64_t y, int64_t z, Coverage coverage,
             double eps) {
  const Point v[3] = {ToReal(a), ToReal(b), ToReal(c)};
  const Point centre{Real(x) + 0.5L, Real(y) + 0.5L, Real(z) + 0.5L};
  const Real half = 0.5L + eps;
  const Point n = Cross(v[1] - v[0], v[2] - v[1]);
  const Real largest = std::max({std::fabs(n.x), std::fabs(n.y), std::fabs(n.z)});
  Real longest = 0;
  for (int i = 0; i < 3; ++i) {
    const Point e = v[(i + 1) % 3] - v[i];
    longest = std::max(longest, Dot(e, e));
  }
  const bool degenerate = largest <= Real(kDegenerateRatio) * longest;
  if (degenerate && coverage != Coverage::kConservative && eps < 0) return false;
  if (coverage == Coverage::kConservative || degenerate) return MeetsBox(v, centre, {half, half, half});
  const bool slab = std::fabs(Dot(n, centre - v[0])) <= half * largest;
  if (coverage == Coverage::kThin) return slab && MeetsBox(v, centre, {half, half, half});
  // center: the triangle, projected along the dominant axis, within eps of the centre; near-ties may go either way.
  bool any = false, all = true;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::fabs(n[axis]) < largest * (1 - 1e-6L)) continue;
    bool hit = false;
    if (eps >= 0) {
      Point thin_box{eps, eps, eps};
      thin_box[axis] = half;
      hit = MeetsBox(v, centre, thin_box);
    } else {  // inside every projected edge by at least -eps
      const int u = (axis + 1) % 3, w = (axis + 2) % 3;
      hit = slab;
      for (int i = 0; i < 3; ++i) {
        const Point &p = v[i], &q = v[(i + 1) % 3];
        const Real du = q[u] - p[u], dw = q[w] - p[w];
        const Real side = (du * (centre[w] - p[w]) - dw * (centre[u] - p[u])) * (n[axis] > 0 ? 1 : -1);
        hit = hit && side >= -Real(eps) * std::sqrt(du * du + dw * dw);
      }
    }
    any = any || hit;
    all = all && hit;
  }
  return eps >= 0 ? any : all;
}

int WindingNumber(const std::vector<Vec3d>& positions, const std::vector<std::array<uint32_t, 3>>& triangles,
                  const Vec3d& p) {
  double sum = 0;
  for (const auto& t : triangles) {
    const Vec3d a = positions[t[0]] - p, b = positions[t[1]] - p, c = positions[t[2]] - p;
    const double la = std::sqrt(Dot(a, a)), lb = std::sqrt(Dot(b, b)), lc = std::sqrt(Dot(c, c));
    sum += 2 * std::atan2(Dot(a, Cross(b, c)), la * lb * lc + Dot(a, b) * lc + Dot(b, c) * la + Dot(c, a) * lb);
  }
  return int(std::lround(sum / (4 * std::numbers::pi)));
}

double Distance(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const auto to_segment = [&](const Vec3d& u, const Vec3d& v) {
    const Vec3d e = v - u, d = p - u;
    const double length = Dot(e, e), t = length > 0 ? std::clamp(Dot(d, e) / length, 0.0, 1.0) : 0.0;
    const Vec3d r = d - e * t;
    return std::sqrt(Dot(r, r));
  };
  double best = std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
  const Vec3d n = Cross(b - a, c - a);
  const double nn = Dot(n, n);
  if (nn > 0) {
    const bool inside =
        Dot(Cross(b - a, p - a), n) >= 0 && Dot(Cross(c - b, p - b), n) >= 0 && Dot(Cross(a - c, p - c), n) >= 0;
    if (inside) best = std::min(best, std::fabs(Dot(n, p - a)) / std::sqrt(nn));
  }
  return best;
}

}  // namespace voxelpipe::testing
