#include "support/meshes/meshes.h"

#include <cmath>
#include <iterator>
#include <limits>
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

TriangleMesh AttributedSoup(int triangles, double extent, uint32_t seed) {
  TriangleMesh mesh = Soup(triangles, extent, seed);
  std::mt19937 random(seed + 1);
  const auto uniform = [&](double lo, double hi) {
    return float(std::uniform_real_distribution<double>(lo, hi)(random));
  };
  const float infinity = std::numeric_limits<float>::infinity();
  const float hostile[] = {-0.0f,     0.0f,     1.0f,      0.5f,    -7.25f, 300.0f,   0.5f / 255,  2.5f / 65535,
                           65504.0f,  65519.0f, -65520.0f, 3.4e38f, 1e-8f,  2.98e-8f, 1e-42f,      infinity,
                           -infinity, NAN,      1e10f,     -1e12f,  0.25f,  2.5f,     16777216.0f, 4294967040.0f};
  const auto pick = [&] { return hostile[random() % std::size(hostile)]; };
  for (int i = 0; i < triangles; ++i) {
    // Colours alike on the whole triangle arrive as they are; mixed ones meet 0 * infinity.
    const bool alike = i % 4 != 0;
    Vec4f color{pick(), pick(), pick(), pick()};
    for (int corner = 0; corner < 3; ++corner) {
      if (!alike) color = {uniform(-1, 2), pick(), uniform(0, 1), uniform(0, 1)};
      mesh.colors.push_back(color);
      const double z = uniform(-1, 1), x = std::sqrt(1 - z * z);
      mesh.normals.push_back({float(x), 0, float(z)});
      mesh.tangents.push_back({0, 1, 0, i % 2 == 0 ? 1.0f : -1.0f});
      for (auto& uv : mesh.uv) uv.push_back({uniform(-1, 2), uniform(-1, 2)});
    }
  }
  VertexAttribute heat{"_HEAT", 2, {}};
  for (int i = 0; i < 6 * triangles; ++i) heat.values.push_back(uniform(-300, 300));
  mesh.attributes = {heat};
  Material material;
  material.base_color_factor = {0.75f, 0.5f, 1, 1};
  material.emissive_factor = {0.5f, 0.25f, 1};
  material.emissive_strength = 3;
  material.metallic_factor = 0.5f;
  material.alpha_mode = AlphaMode::kMask;
  material.alpha_cutoff = 0.4f;
  material.base_color.texture = material.emissive.texture = material.metallic_roughness.texture = 0;
  Texture texture;
  texture.image = 0;
  auto image = std::make_shared<Image>();
  image->width = image->height = 4;
  for (int i = 0; i < 64; ++i) image->rgba.push_back(uint8_t(random()));
  mesh.materials = {material};
  mesh.textures = {texture};
  mesh.images = {image};
  const auto half = uint64_t(triangles / 2);
  MeshPart part;
  part.has_normals = part.has_tangents = part.has_colors = part.has_uv[0] = part.has_uv[1] = true;
  part.material = 0;
  part.triangle_count = half;
  part.vertex_count = 3 * half;
  MeshPart rest = part;
  rest.material = -1;
  rest.mesh = 3;
  rest.first_triangle = half;
  rest.first_vertex = 3 * half;
  rest.triangle_count = uint64_t(triangles) - half;
  rest.vertex_count = 3 * rest.triangle_count;
  mesh.parts = {part, rest};
  return mesh;
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
