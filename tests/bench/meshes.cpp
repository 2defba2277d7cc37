#include "bench/meshes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

namespace voxelpipe::bench {
namespace {

// PCG (M. O'Neill, 2014), 32 bits.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed * 6364136223846793005ull + 1442695040888963407ull) {}
  uint32_t Next() {
    const uint64_t old = state_;
    state_ = old * 6364136223846793005ull + 1442695040888963407ull;
    const auto xored = uint32_t(((old >> 18) ^ old) >> 27);
    const auto turn = uint32_t(old >> 59);
    return xored >> turn | xored << ((32 - turn) & 31);
  }
  // In [-1, 1).
  double Signed() { return double(Next()) * 0x1p-31 - 1; }

 private:
  uint64_t state_;
};

TriangleMesh Finish(TriangleMesh mesh) {
  MeshPart part;
  part.triangle_count = mesh.triangles.size();
  part.vertex_count = mesh.positions.size();
  mesh.parts = {part};
  mesh.unused_vertices.emplace();
  return mesh;
}

// A closed grid of rows x columns points, both ways around (torus) or from pole to pole (sphere).
template <typename Point>
TriangleMesh Surface(int64_t rows, int64_t columns, bool torus, const Point& point) {
  TriangleMesh mesh;
  const int64_t points = torus ? rows : rows + 1;
  for (int64_t r = 0; r < points; ++r) {
    for (int64_t c = 0; c < columns; ++c)
      mesh.positions.push_back(point(double(r) / double(rows), double(c) / double(columns)));
  }
  const auto at = [&](int64_t r, int64_t c) { return uint32_t(r % points * columns + c % columns); };
  for (int64_t r = 0; r < rows; ++r) {
    for (int64_t c = 0; c < columns; ++c) {
      mesh.triangles.push_back({at(r, c), at(r + 1, c), at(r + 1, c + 1)});
      mesh.triangles.push_back({at(r, c), at(r + 1, c + 1), at(r, c + 1)});
    }
  }
  return Finish(std::move(mesh));
}

double Bumps(double u, double v) {
  const double pi = std::numbers::pi;
  return 1 + 0.06 * std::sin(10 * pi * u) * std::sin(14 * pi * v) +
         0.02 * std::sin(46 * pi * u + 3) * std::cos(38 * pi * v);
}

}  // namespace

TriangleMesh BumpySphere(int64_t triangles) {
  const auto rows = int64_t(std::sqrt(double(triangles) / 4));
  return Surface(rows, 2 * rows, false, [](double u, double v) {
    const double r = 0.45 * Bumps(u, v), a = std::numbers::pi * u, b = 2 * std::numbers::pi * v;
    return Vec3d{0.5 + r * std::sin(a) * std::cos(b), 0.5 + r * std::cos(a), 0.5 + r * std::sin(a) * std::sin(b)};
  });
}

TriangleMesh BumpyTorus(int64_t triangles) {
  const auto rows = int64_t(std::sqrt(double(triangles) / 6));
  return Surface(rows, 3 * rows, true, [](double u, double v) {
    const double a = 2 * std::numbers::pi * u, b = 2 * std::numbers::pi * v, r = 0.12 * Bumps(u, v);
    const double ring = 0.33 + r * std::cos(a);
    return Vec3d{0.5 + ring * std::cos(b), 0.5 + r * std::sin(a), 0.5 + ring * std::sin(b)};
  });
}

namespace {

// The mesh clustered by `cells` cells along the longest extent of its box.
TriangleMesh Clustered(const TriangleMesh& mesh, int64_t cells) {
  Vec3d lo = mesh.positions.at(0), hi = lo;
  for (const Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) {
      lo[i] = std::min(lo[i], p[i]);
      hi[i] = std::max(hi[i], p[i]);
    }
  }
  const double scale = double(cells) / std::max({hi.x - lo.x, hi.y - lo.y, hi.z - lo.z});
  TriangleMesh out;
  std::map<std::array<int64_t, 3>, uint32_t> known;
  std::vector<uint32_t> cluster;
  std::vector<double> members;
  for (const Vec3d& p : mesh.positions) {
    const Vec3d at = (p - lo) * scale;
    const auto [cell, added] =
        known.try_emplace({int64_t(at.x), int64_t(at.y), int64_t(at.z)}, uint32_t(out.positions.size()));
    if (added) {
      out.positions.push_back({});
      members.push_back(0);
    }
    cluster.push_back(cell->second);
    out.positions[cell->second] = out.positions[cell->second] + p;
    members[cell->second] += 1;
  }
  for (size_t i = 0; i < members.size(); ++i) out.positions[i] = out.positions[i] * (1 / members[i]);
  for (const auto& t : mesh.triangles) {
    const uint32_t a = cluster[t[0]], b = cluster[t[1]], c = cluster[t[2]];
    if (a != b && b != c && c != a) out.triangles.push_back({a, b, c});
  }
  out = Finish(std::move(out));
  out.unused_vertices.reset();
  return out;
}

}  // namespace

TriangleMesh Decimated(const TriangleMesh& mesh, int64_t triangles) {
  int64_t few = 1, many = 4096;  // cells that give few enough triangles, and too many or as fine as it gets
  while (many - few > 1) {
    const int64_t middle = (few + many) / 2;
    (int64_t(Clustered(mesh, middle).triangles.size()) <= triangles ? few : many) = middle;
  }
  return Clustered(mesh, few);
}

TriangleMesh Subdivided(const TriangleMesh& mesh, int times) {
  TriangleMesh out;
  out.positions = mesh.positions;
  out.triangles = mesh.triangles;
  Random random(7);
  for (int i = 0; i < times; ++i) {
    std::vector<std::array<uint32_t, 3>> finer;
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [known, added] = middles.try_emplace(std::minmax(a, b), uint32_t(out.positions.size()));
      if (added) {
        const Vec3d p = out.positions[a], q = out.positions[b];
        const double jitter = 0.1 * std::sqrt(Dot(q - p, q - p));
        const Vec3d moved{random.Signed() * jitter, random.Signed() * jitter, random.Signed() * jitter};
        out.positions.push_back((p + q) * 0.5 + moved * 0.5);
      }
      return known->second;
    };
    for (const auto& [a, b, c] : out.triangles) {
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    out.triangles = std::move(finer);
  }
  out = Finish(std::move(out));
  out.unused_vertices = mesh.unused_vertices;  // the first vertices are the given ones
  return out;
}

namespace {

// Triangles that share no vertices, some given and many tiny ones in clusters, in random order.
class Scattered {
 public:
  explicit Scattered(uint64_t seed) : random_(seed) {}

  Vec3d Point(const Vec3d& centre, double reach) {
    return centre + Vec3d{random_.Signed() * reach, random_.Signed() * reach, random_.Signed() * reach};
  }
  void Add(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto first = uint32_t(mesh_.positions.size());
    mesh_.positions.insert(mesh_.positions.end(), {a, b, c});
    mesh_.triangles.push_back({first, first + 1, first + 2});
  }
  void AddClusters(int clusters, int64_t triangles) {
    std::vector<Vec3d> centres;
    for (int i = 0; i < clusters; ++i) centres.push_back(Point({0.5, 0.5, 0.5}, 0.45));
    for (int64_t i = 0; i < triangles; ++i) {
      const Vec3d at = Point(centres[random_.Next() % centres.size()], 0.04);
      Add(Point(at, 0.0015), Point(at, 0.0015), Point(at, 0.0015));
    }
  }
  // A triangle's vertices move with it, as in a file without indices.
  TriangleMesh Shuffled() {
    for (size_t i = mesh_.triangles.size() - 1; i > 0; --i) {
      const size_t other = random_.Next() % (i + 1);
      for (int corner = 0; corner < 3; ++corner) {
        std::swap(mesh_.positions[3 * i + corner], mesh_.positions[3 * other + corner]);
      }
    }
    return Finish(std::move(mesh_));
  }

 private:
  TriangleMesh mesh_;
  Random random_;
};

}  // namespace

TriangleMesh Mixed() {
  Scattered mesh(11);
  const Vec3d middle{0.5, 0.5, 0.5};
  for (int i = 0; i < 92; ++i) mesh.Add(mesh.Point(middle, 0.5), mesh.Point(middle, 0.5), mesh.Point(middle, 0.5));
  mesh.AddClusters(40, 120'000);
  return mesh.Shuffled();
}

TriangleMesh Nasty() {
  Scattered mesh(12);
  for (int i = 0; i < 12; ++i) {
    // A point near the middle and two directions at right angles.
    const Vec3d at = mesh.Point({0.5, 0.5, 0.5}, 0.3), n = mesh.Point({0, 0, 0}, 1);
    Vec3d u = Cross(n, std::abs(n.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0});
    u = u * (1.2 / std::sqrt(Dot(u, u)));
    Vec3d v = Cross(n, u);
    v = v * (1.2 / std::sqrt(Dot(v, v)));
    mesh.Add(at - u - v, at + u - v, at - u + v);
    mesh.Add(at + u + v, at - u + v, at + u - v);
  }
  mesh.AddClusters(40, 2'000'000);
  return mesh.Shuffled();
}

TriangleMesh Maze(int cells) {
  using Cell = std::array<int, 3>;
  const auto at = [cells](const Cell& c) { return size_t(c[0] + cells * (c[1] + cells * c[2])); };
  // Of each room: whether the way came there, and, by axis, whether the wall above it has a door.
  std::vector<uint8_t> seen(at({0, 0, cells}));
  std::vector<std::array<bool, 3>> doors(seen.size());
  Random random(13);
  seen[0] = 1;
  for (std::vector<Cell> way{{0, 0, 0}}; !way.empty();) {
    const Cell here = way.back();
    std::vector<std::pair<size_t, Cell>> next;
    for (size_t axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, 1}) {
        Cell to = here;
        to[axis] += step;
        if (to[axis] >= 0 && to[axis] < cells && !seen[at(to)]) next.emplace_back(axis, to);
      }
    }
    if (next.empty()) {
      way.pop_back();
      continue;
    }
    const auto [axis, to] = next[random.Next() % next.size()];
    doors[at(std::min(here, to))][axis] = true;
    seen[at(to)] = 1;
    way.push_back(to);
  }
  TriangleMesh mesh;
  const auto corner = [cells](const Cell& c) { return uint32_t(c[0] + (cells + 1) * (c[1] + (cells + 1) * c[2])); };
  for (int z = 0; z <= cells; ++z) {
    for (int y = 0; y <= cells; ++y) {
      for (int x = 0; x <= cells; ++x)
        mesh.positions.push_back(Vec3d{double(x), double(y), double(z)} * (1 / double(cells)));
    }
  }
  for (size_t axis = 0; axis < 3; ++axis) {
    const size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (int level = 0; level <= cells; ++level) {
      for (int i = 0; i < cells; ++i) {
        for (int j = 0; j < cells; ++j) {
          Cell a{}, below{};
          a[axis] = level, a[u] = i, a[v] = j;
          below = a;
          --below[axis];
          const bool opening = axis == 2 && level == 0 && i == 0 && j == 0;
          if (opening || (level > 0 && level < cells && doors[at(below)][axis])) continue;
          Cell b = a, c = a, d = a;
          ++b[u], ++c[u], ++c[v], ++d[v];
          mesh.triangles.push_back({corner(a), corner(b), corner(c)});
          mesh.triangles.push_back({corner(a), corner(c), corner(d)});
        }
      }
    }
  }
  return Finish(std::move(mesh));
}

}  // namespace voxelpipe::bench
