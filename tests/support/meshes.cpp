#include "support/meshes.h"

#include <cmath>
#include <numbers>
#include <random>

namespace voxelpipe::testing {

TriangleMesh MakeMesh(std::vector<Vec3d> positions, std::vector<std::array<uint32_t, 3>> triangles) {
  TriangleMesh mesh;
  mesh.positions = std::move(positions);
  mesh.triangles = std::move(triangles);
  MeshPart part;
  part.triangle_count = mesh.triangles.size();
  part.vertex_count = mesh.positions.size();
  mesh.parts.push_back(part);
  return mesh;
}

TriangleMesh Cube(double s) {
  std::vector<Vec3d> p;
  for (int i = 0; i < 8; ++i) p.push_back({i & 1 ? s : 0, i & 2 ? s : 0, i & 4 ? s : 0});
  return MakeMesh(p, {{0, 2, 1},
                      {1, 2, 3},
                      {4, 5, 6},
                      {5, 7, 6},
                      {0, 1, 4},
                      {1, 5, 4},
                      {2, 6, 3},
                      {3, 6, 7},
                      {0, 4, 2},
                      {2, 4, 6},
                      {1, 3, 5},
                      {3, 7, 5}});
}

TriangleMesh Octahedron(double r, const Mat4d& turn, const Vec3d& centre) {
  std::vector<Vec3d> p;
  for (int a = 0; a < 3; ++a) {
    for (const double sign : {1.0, -1.0}) {
      Vec3d v{};
      v[a] = sign * r;
      p.push_back(TransformVector(turn, v) + centre);
    }
  }
  return MakeMesh(p, {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}});
}

TriangleMesh BumpySphere(int rings, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> radius(0.8, 1.0);
  std::vector<Vec3d> p{{0, 0, 1}};
  const int columns = 2 * rings;
  for (int i = 1; i < rings; ++i) {
    for (int j = 0; j < columns; ++j) {
      const double theta = std::numbers::pi * i / rings, phi = 2 * std::numbers::pi * j / columns;
      const double r = radius(random);
      p.push_back({r * std::sin(theta) * std::cos(phi), r * std::sin(theta) * std::sin(phi), r * std::cos(theta)});
    }
  }
  p.push_back({0, 0, -1});
  const auto at = [&](int i, int j) -> uint32_t {
    if (i == 0) return 0;
    if (i == rings) return uint32_t(p.size() - 1);
    return uint32_t(1 + (i - 1) * columns + j % columns);
  };
  std::vector<std::array<uint32_t, 3>> t;
  for (int i = 0; i < rings; ++i) {
    for (int j = 0; j < columns; ++j) {
      if (i > 0) t.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i + 1 < rings) t.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  }
  return MakeMesh(p, t);
}

TriangleMesh Torus(int n) {
  std::vector<Vec3d> p;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / n, r = 1 + 0.4 * std::cos(v);
      p.push_back({r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v)});
    }
  }
  std::vector<std::array<uint32_t, 3>> t;
  const auto at = [&](int i, int j) { return uint32_t(i % n * n + j % n); };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      t.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      t.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  }
  return MakeMesh(p, t);
}

TriangleMesh Soup(int triangles, double extent, uint32_t seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(random); };
  const auto point = [&](double lo, double hi) { return Vec3d{uniform(lo, hi), uniform(lo, hi), uniform(lo, hi)}; };
  std::vector<Vec3d> p;
  std::vector<std::array<uint32_t, 3>> t;
  for (int i = 0; i < triangles; ++i) {
    Vec3d a = point(0, extent), b, c;
    switch (i % 8) {
      case 0:  // about a voxel
        b = a + point(-1, 1);
        c = a + point(-1, 1);
        break;
      case 1:  // some voxels
        b = a + point(-6, 6);
        c = a + point(-6, 6);
        break;
      case 2: {  // sliver
        b = a + point(-8, 8);
        c = (a + b) * 0.5 + point(-1e-6, 1e-6);
        break;
      }
      case 3:  // exactly collinear
        a = {std::floor(a.x), std::floor(a.y), std::floor(a.z)};
        b = a + Vec3d{2, 4, -2};
        c = a + Vec3d{1, 2, -1};
        break;
      case 4:  // a point
        b = c = a;
        break;
      case 5:  // huge, through the grid from far outside
        a = point(-40 * extent, 40 * extent);
        b = point(-40 * extent, 40 * extent);
        c = point(0, extent);
        break;
      case 6:  // on lattice planes: every comparison ties
        a = {std::floor(a.x), std::floor(a.y), std::floor(a.z)};
        b = a + Vec3d{std::floor(uniform(-4, 5)), std::floor(uniform(-4, 5)), 0};
        c = a + Vec3d{0, std::floor(uniform(-4, 5)), std::floor(uniform(-4, 5))};
        break;
      default:  // outside, touching nothing or the border
        a = point(extent, 2 * extent);
        b = a + point(-2, 2);
        c = a + point(-2, 2);
    }
    const uint32_t v = uint32_t(p.size());
    p.insert(p.end(), {a, b, c});
    t.push_back({v, v + 1, v + 2});
  }
  return MakeMesh(p, t);
}

Mat4d Rotation(const Vec3d& k, double angle) {
  const double c = std::cos(angle), s = std::sin(angle), u = 1 - c;
  Mat4d m;
  m.m[0][0] = c + k.x * k.x * u;
  m.m[0][1] = k.x * k.y * u - k.z * s;
  m.m[0][2] = k.x * k.z * u + k.y * s;
  m.m[1][0] = k.y * k.x * u + k.z * s;
  m.m[1][1] = c + k.y * k.y * u;
  m.m[1][2] = k.y * k.z * u - k.x * s;
  m.m[2][0] = k.z * k.x * u - k.y * s;
  m.m[2][1] = k.z * k.y * u + k.x * s;
  m.m[2][2] = c + k.z * k.z * u;
  return m;
}

}  // namespace voxelpipe::testing
