#include "gpu/cases/parity_meshes.h"

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "bench/meshes.h"
#include "gpu/cases/rigged_mesh.h"
#include "load/decode/image.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

using testing::MakeMesh;

// Triangles that share no vertices.
class Loose {
 public:
  void Add(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto first = uint32_t(positions_.size());
    positions_.insert(positions_.end(), {a, b, c});
    triangles_.push_back({first, first + 1, first + 2});
  }
  TriangleMesh Take() { return MakeMesh(std::move(positions_), std::move(triangles_)); }

 private:
  std::vector<Vec3d> positions_;
  std::vector<std::array<uint32_t, 3>> triangles_;
};

class Random {
 public:
  explicit Random(uint32_t seed) : random_(seed) {}
  double operator()(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(random_); }
  Vec3d Point(double lo, double hi) {
    const double x = (*this)(lo, hi), y = (*this)(lo, hi), z = (*this)(lo, hi);
    return {x, y, z};
  }
  int64_t Whole(int64_t lo, int64_t hi) { return std::uniform_int_distribution<int64_t>(lo, hi)(random_); }

 private:
  std::mt19937 random_;
};

TriangleMesh Moved(TriangleMesh mesh, double scale, const Vec3d& by) {
  for (Vec3d& p : mesh.positions) p = p * scale + by;
  return mesh;
}

TriangleMesh One(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return MakeMesh({a, b, c}, {{0, 1, 2}});
}

// Squares on lattice planes of all three axes, every comparison a tie; `at` is the offset from whole voxels.
TriangleMesh LatticeSheets(double at) {
  Loose mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double plane : {0.0, 7.0, 8.0, 31.0, 32.0, 40.0}) {
      Vec3d p[4];
      for (int i = 0; i < 4; ++i) {
        p[i][axis] = plane + at;
        p[i][(axis + 1) % 3] = (i & 1 ? 33 : 2) + at;
        p[i][(axis + 2) % 3] = (i & 2 ? 24 : -1) + at;
      }
      mesh.Add(p[0], p[1], p[2]);
      mesh.Add(p[3], p[2], p[1]);
    }
  }
  return mesh.Take();
}

// Triangles whose corners lie on or one ulp beside the corners of tiles (32 x 8 x 8 voxels).
TriangleMesh TileCorners(uint32_t seed) {
  Random random(seed);
  Loose mesh;
  const auto corner = [&] {
    Vec3d p{32.0 * double(random.Whole(0, 2)), 8.0 * double(random.Whole(0, 6)), 8.0 * double(random.Whole(0, 6))};
    for (int i = 0; i < 3; ++i) {
      const int64_t side = random.Whole(-1, 1);
      if (side != 0) p[i] = std::nextafter(p[i], side * std::numeric_limits<double>::infinity());
    }
    return p;
  };
  for (int i = 0; i < 60; ++i) {
    const Vec3d a = corner(), b = corner();
    mesh.Add(a, b, corner());
  }
  return mesh.Take();
}

// Needles along one axis, through many tiles, a few voxels to a thousandth of a voxel thick.
TriangleMesh Needles(int axis, double extent, uint32_t seed) {
  Random random(seed);
  Loose mesh;
  for (int i = 0; i < 300; ++i) {
    Vec3d a = random.Point(0, extent), b = a, c = a;
    a[axis] = random(-extent, extent / 2);
    b[axis] = random(extent / 2, 2 * extent);
    c[axis] = random(0, extent);
    const double thickness = std::pow(10.0, random(-3, 0.5));
    b = b + random.Point(-2, 2);
    c = c + random.Point(-thickness, thickness);
    mesh.Add(a, b, c);
  }
  return mesh.Take();
}

// `count` triangles of about `size` voxels around one point.
TriangleMesh Pile(int count, const Vec3d& at, double spread, double size, uint32_t seed) {
  Random random(seed);
  Loose mesh;
  for (int i = 0; i < count; ++i) {
    const Vec3d a = at + random.Point(-spread, spread);
    const Vec3d b = a + random.Point(-size, size);
    mesh.Add(a, b, a + random.Point(-size, size));
  }
  return mesh.Take();
}

// Triangles as large as the grid and far larger, all through it.
TriangleMesh Giants(int count, double extent, double reach, uint32_t seed) {
  Random random(seed);
  Loose mesh;
  for (int i = 0; i < count; ++i) {
    const Vec3d a = random.Point(-reach, reach), b = random.Point(-reach, reach);
    mesh.Add(a, b, random.Point(0, extent));
  }
  return mesh.Take();
}

// Small triangles one beside the other, and after some of them another one, of a few voxels or as large as a part of
// the mesh; in three places many of them one after the other.
TriangleMesh OfAllSizes(uint32_t seed) {
  Random random(seed);
  TriangleMesh mesh = Moved(bench::BumpySphere(9000), 80, {0, 0, 0});
  std::vector<std::array<uint32_t, 3>> triangles;
  const auto add = [&](const Vec3d& at, double reach) {
    const auto first = uint32_t(mesh.positions.size());
    mesh.positions.insert(mesh.positions.end(),
                          {at, at + random.Point(-reach, reach), at + random.Point(-reach, reach)});
    triangles.push_back({first, first + 1, first + 2});
  };
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto corners = mesh.triangles[i];
    const Vec3d at = mesh.positions[corners[0]];
    triangles.push_back(corners);
    if (i % 83 == 40) add(at, 25);
    if (i % 29 == 20) add(at, 5);
    if (i % 3000 < 40) add(at, 3);
  }
  return MakeMesh(std::move(mesh.positions), std::move(triangles));
}

TriangleMesh NestedSpheres() {
  TriangleMesh all = Moved(testing::BumpySphere(16, 3), 22, {24, 24, 24});
  for (const double r : {15.0, 9.0, 4.0}) {
    const TriangleMesh inner = Moved(testing::BumpySphere(12, uint32_t(r)), r, {24, 24, 24});
    const auto first = uint32_t(all.positions.size());
    all.positions.insert(all.positions.end(), inner.positions.begin(), inner.positions.end());
    for (const auto& t : inner.triangles) all.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  return MakeMesh(std::move(all.positions), std::move(all.triangles));
}

// Every triangle three times, so that only ids tell fragments apart.
TriangleMesh Threefold(const TriangleMesh& mesh) {
  auto triangles = mesh.triangles;
  for (int i = 0; i < 2; ++i) triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
  return MakeMesh(mesh.positions, triangles);
}

TriangleMesh Halved(TriangleMesh mesh) {
  mesh.triangles.resize(mesh.triangles.size() / 2);
  return MakeMesh(std::move(mesh.positions), std::move(mesh.triangles));
}

TriangleMesh WithMips(TriangleMesh mesh) {
  // A texture large enough for several levels.
  auto image = std::make_shared<Image>();
  std::mt19937 random(9);
  image->width = 37;
  image->height = 18;
  for (uint32_t i = 0; i < 4 * image->width * image->height; ++i) image->rgba.push_back(uint8_t(random()));
  mesh.images = {image};
  (void)PrepareTextures(mesh);
  return mesh;
}

}  // namespace

std::vector<ParityMesh> ParityMeshes(uint32_t seed) {
  std::vector<ParityMesh> all;
  const auto add = [&](const char* name, double extent, std::function<TriangleMesh()> make) {
    all.push_back({name, extent, std::move(make)});
  };
  using testing::AttributedSoup;
  using testing::Soup;
  add("attributed96", 20, [=] { return AttributedSoup(96, 20, seed + 21); });
  add("attributed400", 48, [=] { return AttributedSoup(400, 48, seed + 22); });
  add("textured200", 36, [=] { return WithMips(AttributedSoup(200, 36, seed + 23)); });
  add("soup96", 20, [=] { return Soup(96, 20, seed + 1); });
  add("soup800", 60, [=] { return Soup(800, 60, seed + 2); });
  add("soup5000", 100, [=] { return Soup(5000, 100, seed + 3); });
  add("cube", 24, [] { return Moved(testing::Cube(20), 1, {2, 2, 2}); });
  add("cube_between", 24, [] { return Moved(testing::Cube(19.7), 1, {1.3, 2.5, 0.7}); });
  add("octahedron", 40, [] {
    return testing::Octahedron(17, testing::Rotation({0.6, 0.8, 0}, 0.7), {20.1, 19.3, 20.5});
  });
  add("sphere", 48, [=] { return Moved(testing::BumpySphere(24, seed + 9), 22, {24, 24, 24}); });
  add("torus", 70, [] { return Moved(testing::Torus(40), 24, {35, 35, 35}); });
  add("sphere20k", 96, [] { return Moved(bench::BumpySphere(20'000), 96, {0, 0, 0}); });
  add("torus60k", 130, [] { return Moved(bench::BumpyTorus(60'000), 130, {0, 0, 0}); });
  add("subdivided", 64, [] { return Moved(bench::Subdivided(bench::BumpySphere(900), 2), 64, {0, 0, 0}); });
  add("mixed120k", 128, [] { return Moved(bench::Mixed(), 128, {0, 0, 0}); });
  add("nested", 48, [] { return NestedSpheres(); });
  add("open_half_sphere", 48, [] { return Halved(Moved(testing::BumpySphere(20, 5), 22, {24, 24, 24})); });
  add("threefold", 40, [] { return Threefold(Moved(testing::Torus(12), 13, {20, 20, 20})); });
  add("lattice_sheets", 41, [] { return LatticeSheets(0); });
  add("centre_sheets", 41, [] { return LatticeSheets(0.5); });
  add("tile_corners", 66, [=] { return TileCorners(seed + 4); });
  add("needles_x", 70, [=] { return Needles(0, 70, seed + 5); });
  add("needles_y", 45, [=] { return Needles(1, 45, seed + 6); });
  add("needles_z", 45, [=] { return Needles(2, 45, seed + 7); });
  add("pile_in_a_voxel", 20, [=] { return Pile(9000, {10.5, 9.5, 8.5}, 0.2, 0.2, seed + 8); });
  add("pile_in_a_tile", 40, [=] { return Pile(4000, {16, 12, 12}, 3, 9, seed + 9); });
  add("piles_apart", 100, [=] {
    Loose mesh;
    Random random(seed + 10);
    for (int i = 0; i < 20; ++i) {
      const Vec3d at = random.Point(5, 95);
      for (int j = 0; j < 300; ++j) {
        const Vec3d a = at + random.Point(-1, 1);
        mesh.Add(a, a + random.Point(-0.3, 0.3), a + random.Point(-0.3, 0.3));
      }
    }
    return mesh.Take();
  });
  add("scattered", 110, [=] {  // neighbours far apart, a giant now and then: more than kernels draw apart
    Loose mesh;
    Random random(seed + 15);
    for (int i = 0; i < 4500; ++i) {
      const Vec3d a = random.Point(0, 110);
      const double reach = i % 100 == 7 ? 400 : random(0.2, 4);
      mesh.Add(a, a + random.Point(-reach, reach), a + random.Point(-reach, reach));
    }
    return mesh.Take();
  });
  add("giants", 60, [=] { return Giants(40, 60, 120, seed + 11); });
  add("giants_far", 40, [=] { return Giants(24, 40, 60'000, seed + 12); });
  add("giants_beyond", 30, [=] { return Giants(12, 30, 0x1p36, seed + 13); });
  add("slivers", 50, [=] {
    Loose mesh;
    Random random(seed + 14);
    for (int i = 0; i < 400; ++i) {
      const Vec3d a = random.Point(0, 50), b = random.Point(0, 50);
      const double away = std::pow(10.0, random(-12, -1));
      mesh.Add(a, b, a + (b - a) * random(0, 1) + random.Point(-away, away));
    }
    return mesh.Take();
  });
  add("triangle", 20, [] { return One({2.2, 3.1, 4.7}, {17.9, 5.2, 6.1}, {9.4, 16.3, 12.8}); });
  add("triangle_in_plane", 40, [] { return One({-5, -7, 8}, {90, 3, 8}, {3, 80, 8}); });
  add("point", 10, [] { return One({5, 5, 5}, {5, 5, 5}, {5, 5, 5}); });
  add("collinear", 20, [] { return One({1, 2, 3}, {9, 18, 7}, {5, 10, 5}); });
  add("no_triangles", 10, [] { return MakeMesh({{1, 2, 3}}, {}); });
  add("nothing", 10, [] { return TriangleMesh(); });
  add("outside", 20, [] { return Moved(testing::BumpySphere(8, 2), 5, {70, -30, 10}); });
  add("touching_from_outside", 24, [] { return Moved(testing::Cube(6), 1, {24, 24, 24}); });
  add("rigged", 40, [=] { return RiggedMesh(seed + 15); });
  const double infinity = std::numeric_limits<double>::infinity();
  all.push_back({"infinite_vertex", 20, [=] { return One({1, 2, 3}, {infinity, 2, 5}, {9, 1, 5}); }, true});
  all.push_back({"far_vertex", 20, [] { return One({1, 2, 3}, {0x1p41, 2, 5}, {9, 1, 5}); }, true});
  // More fragments than there are by any guess from its triangles or the grid's voxels.
  add("crowd", 8, [=] { return Giants(900, 8, 24, seed + 16); });
  add("sphere5k", 72, [] {
    return Moved(bench::BumpySphere(5000), 72, {0, 0, 0});
  });  // its triangles are rasterized by rows
  add("of_all_sizes", 80, [=] { return OfAllSizes(seed + 17); });
  // Likewise more fragments than by any guess, of small triangles, which are bundled where the cache is small.
  add("throng", 8, [=] { return Pile(900, {4, 4, 4}, 4, 1.5, seed + 18); });
  return all;
}

}  // namespace voxelpipe::gpu
