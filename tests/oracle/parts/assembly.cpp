#include "oracle/parts/assembly.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <utility>

#include "mesh/placed_mesh.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::testing {
namespace {

// Names of their own for few, shared by some, empty for others: rules match none, one or many.
constexpr const char* kNames[] = {"hull", "leg", "leg_left", "", "b\xc3\xb6x", "*", "hull"};

class Maker {
 public:
  explicit Maker(const AssemblyKind& kind) : kind_(kind), random_(kind.seed) {}

  Assembly Make() {
    for (int m = 0, count = Whole(0, 3); m < count; ++m) materials_.push_back(MakeMaterial());
    kind_.placed ? Place() : WriteOne();
    return std::move(made_);
  }

 private:
  double Real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  int Whole(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  bool Chance(double share) { return Real(0, 1) < share; }
  std::string SomeName() { return kNames[size_t(Whole(0, int(std::size(kNames)) - 1))]; }

  Material MakeMaterial() {
    Material material;
    material.name = SomeName();
    const auto some = [&] { return float(Whole(0, 8)) / 8; };
    material.base_color_factor = {some(), some(), some(), some()};
    material.emissive_factor = {some(), some(), some()};
    material.emissive_strength = 1.5f;
    material.metallic_factor = some();
    material.roughness_factor = some();
    if (kind_.masks && Chance(0.5)) material.alpha_mode = AlphaMode::kMask;
    material.alpha_cutoff = 0.45f;  // between the factors: with vertex colours alpha is rounded
    return material;
  }

  Mat4d Turn() {
    Vec3d axis{Real(-1, 1), Real(-1, 1), Real(0.1, 1)};
    const double length = std::sqrt(Dot(axis, axis));
    return Rotation(axis * (1 / length), Real(0, 6));
  }

  // About 1 in each direction.
  Body Shape() {
    switch (Whole(0, 4)) {
      case 0: return Box({-1, -0.7, -0.5}, {1, 0.7, 0.5});
      case 1: return BodyOf(Octahedron(1, Mat4d(), {}));
      case 2: return Icosphere(1);
      case 3: return BodyOf(BumpySphere(4, uint32_t(Whole(1, 100))));
      default: return Moved(BodyOf(Torus(6)), Placing(Mat4d(), 0.8, {}));
    }
  }

  // The place of the next body: on lattice points beside the last one, within it, or anywhere.
  Mat4d NextPlace(bool on_lattice) {
    if (on_lattice) {
      const int axis = Whole(0, 2);
      if (Chance(0.7)) {
        last_centre_[axis] = std::floor(last_centre_[axis]) + last_size_ + 2;
      } else {
        for (int a = 0; a < 3; ++a) last_centre_[a] = Whole(0, int(2 * kind_.extent)) * 0.5;
      }
      last_size_ = 2;
      if (last_centre_[axis] > kind_.extent) last_centre_[axis] = 2;
      return Placing(Mat4d(), 2, last_centre_);
    }
    const double largest = kind_.extent / (kind_.bodies <= 5 ? 2.2 : kind_.bodies <= 13 ? 3.2 : 5);
    double size = Real(0.6, largest);
    if (Chance(0.3)) {
      size = last_size_ * 0.6;
    } else {
      for (int a = 0; a < 3; ++a) last_centre_[a] = Real(-1, kind_.extent + 1);
    }
    last_size_ = size;
    Mat4d placing = Placing(Turn(), size, last_centre_);
    if (Chance(0.2)) {
      for (auto& row : placing.m) row[0] = -row[0];
    }
    return placing;
  }

  // A body at the origin and, in `on_lattice`, whether its faces may lie on lattice planes.
  Body NextShape(bool& on_lattice) {
    on_lattice = Chance(0.35);
    Body body = on_lattice ? Box({-1, -1, -1}, {1, 1, 1}) : Shape();
    if (Chance(0.25)) body = InsideOut(std::move(body));
    if (Chance(0.1)) body.triangles.push_back({0, 1, 0});        // without area: it has fragments, and bounds nothing
    if (any_triangles_ && Chance(0.05)) body.triangles.clear();  // only vertices: no part
    any_triangles_ = true;
    if (kind_.open && !body.triangles.empty() && Chance(0.4)) {
      body.triangles.erase(body.triangles.begin(), body.triangles.begin() + Whole(1, 3));
      body.closed = false;
    }
    return body;
  }

  int32_t SomeMaterial() { return Whole(-1, int(materials_.size()) - 1); }

  void WriteOne() {
    made_.files.resize(1);
    std::vector<std::string> node_names, mesh_names;
    for (int n = 0; n < 1 + kind_.bodies / 2; ++n) {
      node_names.push_back(SomeName());
      mesh_names.push_back(SomeName());
    }
    uint32_t instance = 0;
    for (int i = 0; i < kind_.bodies; ++i) {
      bool on_lattice;
      Body shape = NextShape(on_lattice);
      TaggedBody tagged;
      tagged.body = Moved(std::move(shape), NextPlace(on_lattice));
      tagged.node = uint32_t(Whole(0, int(node_names.size()) - 1));
      tagged.mesh = uint32_t(Whole(0, int(mesh_names.size()) - 1));
      if (!made_.bodies.empty()) {
        const TaggedBody& last = made_.bodies.back();
        if (Chance(0.3)) {  // a further primitive of the same instance
          tagged.node = last.node;
          tagged.mesh = last.mesh;
          tagged.primitive = last.primitive + 1;
        } else {  // or another instance, perhaps of the same node
          ++instance;
        }
      }
      tagged.instance = instance;
      tagged.material = SomeMaterial();
      tagged.colors = kind_.colors && Chance(0.2);
      tagged.node_name = node_names[tagged.node];
      tagged.mesh_name = mesh_names[tagged.mesh];
      made_.bodies.push_back(std::move(tagged));
    }
    made_.materials = materials_;
    made_.mesh = WriteMesh(made_.bodies, materials_);
  }

  std::optional<RigidMotionNumbers> SomeMotion() {
    if (!kind_.moves || Chance(0.3)) return std::nullopt;
    const auto v = [&] { return Vec3d{Real(-2, 2), Real(-2, 2), Real(-2, 2)}; };
    return RigidMotionNumbers{v(), v(), v()};
  }

  // The bodies of one file, in its own numbers, at the origin.
  std::vector<TaggedBody> NextFile(bool& on_lattice) {
    std::vector<TaggedBody> file(1);
    file[0].body = NextShape(on_lattice);
    if (Chance(0.3)) {
      bool ignored;
      file.emplace_back().body = Moved(NextShape(ignored), Placing(Mat4d(), on_lattice ? 1 : 0.75, {0.5, 0.5, 0}));
      file.back().node = file.back().instance = 1;
      file.back().mesh = Chance(0.5) ? 1 : 0;
    }
    const std::string names[] = {SomeName(), SomeName()};
    for (TaggedBody& tagged : file) {
      tagged.node_name = names[tagged.node];
      tagged.mesh_name = names[1 - tagged.mesh];
      tagged.material = SomeMaterial();
      tagged.colors = kind_.colors && Chance(0.2);
    }
    return file;
  }

  void Place() {
    std::vector<PlacedMesh> list;
    std::vector<TaggedBody> file;
    std::shared_ptr<const TriangleMesh> mesh;
    bool on_lattice = false;
    uint32_t node = 0, mesh_id = 0, instance = 0;
    for (int i = 0; i < kind_.bodies; ++i) {
      if (mesh == nullptr || Chance(0.7)) {  // otherwise the last mesh again
        file = NextFile(on_lattice);
        mesh = std::make_shared<const TriangleMesh>(WriteMesh(file, materials_));
      }
      PlacedMesh placed;
      placed.mesh = mesh;
      placed.matrix = NextPlace(on_lattice);
      placed.name = SomeName();
      if (Chance(0.3)) placed.label = uint32_t(Whole(1, 9));
      placed.priority = Chance(0.4) ? Whole(-2, 2) : 0;
      placed.motion = SomeMotion();
      made_.files.push_back({placed.name, placed.label.value_or(uint32_t(i + 1)), placed.priority, placed.motion});
      for (TaggedBody tagged : file) {
        tagged.body = Moved(std::move(tagged.body), placed.matrix);
        tagged.file = size_t(i);
        tagged.node += node;
        tagged.instance += instance;
        tagged.mesh += mesh_id;
        if (tagged.material >= 0) tagged.material += int32_t(made_.materials.size());
        made_.bodies.push_back(std::move(tagged));
      }
      made_.materials.insert(made_.materials.end(), materials_.begin(), materials_.end());
      instance += uint32_t(file.size());
      node += mesh->node_count;
      mesh_id += mesh->mesh_count;
      list.push_back(std::move(placed));
    }
    const JobContext job;
    absl::StatusOr<TriangleMesh> joined = PlaceMeshes(job, list);
    made_.mesh = std::move(joined).value();
  }

  const AssemblyKind kind_;
  std::mt19937 random_;
  std::vector<Material> materials_;  // of a file
  Assembly made_;
  Vec3d last_centre_{3, 3, 3};
  double last_size_ = 2;
  bool any_triangles_ = false;
};

}  // namespace

Assembly RandomAssembly(const AssemblyKind& kind) {
  return Maker(kind).Make();
}

Body BodyOf(const TriangleMesh& mesh) {
  return {mesh.positions, mesh.triangles};
}

Body Box(const Vec3d& low, const Vec3d& high) {
  Body box = BodyOf(Cube(1));
  for (Vec3d& p : box.positions) {
    for (int a = 0; a < 3; ++a) p[a] = p[a] == 0 ? low[a] : high[a];
  }
  return box;
}

Body Icosphere(int subdivisions) {
  const Shape shape = IcosphereShape(subdivisions);
  Body body;
  for (const Vec3f& p : shape.positions) body.positions.push_back({p.x, p.y, p.z});
  for (size_t i = 0; i < shape.indices.size(); i += 3) {
    body.triangles.push_back({shape.indices[i], shape.indices[i + 1], shape.indices[i + 2]});
  }
  return body;
}

Body Cylinder(int sides) {
  Body body;
  body.positions = {{0, 0, -1}, {0, 0, 1}};
  const auto n = uint32_t(sides);
  for (uint32_t i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    for (const double z : {-1.0, 1.0}) body.positions.push_back({std::cos(angle), std::sin(angle), z});
    const uint32_t low = 2 + 2 * i, high = low + 1, next_low = 2 + 2 * ((i + 1) % n), next_high = next_low + 1;
    body.triangles.insert(body.triangles.end(), {{0, next_low, low}, {1, high, next_high}});
    body.triangles.insert(body.triangles.end(), {{low, next_low, next_high}, {low, next_high, high}});
  }
  return body;
}

double VolumeOf(const Body& body) {
  double sum = 0;
  for (const auto& t : body.triangles) {
    sum += Dot(body.positions[t[0]], Cross(body.positions[t[1]], body.positions[t[2]])) / 6;
  }
  return std::abs(sum);
}

double AreaOf(const Body& body) {
  double sum = 0;
  for (const auto& t : body.triangles) {
    const Vec3d& a = body.positions[t[0]];
    const Vec3d n = Cross(body.positions[t[1]] - a, body.positions[t[2]] - a);
    sum += std::sqrt(Dot(n, n)) / 2;
  }
  return sum;
}

Body Moved(Body body, const Mat4d& matrix) {
  const auto& m = matrix.m;
  for (Vec3d& p : body.positions) {
    const Vec3d q = p;
    for (int r = 0; r < 3; ++r) p[r] = ((m[r][0] * q.x + m[r][1] * q.y) + m[r][2] * q.z) + m[r][3];
  }
  const Vec3d columns[] = {{m[0][0], m[1][0], m[2][0]}, {m[0][1], m[1][1], m[2][1]}, {m[0][2], m[1][2], m[2][2]}};
  return Dot(columns[0], Cross(columns[1], columns[2])) < 0 ? InsideOut(std::move(body)) : body;
}

Body InsideOut(Body body) {
  for (auto& t : body.triangles) std::swap(t[1], t[2]);
  return body;
}

Mat4d Placing(const Mat4d& turn, double scale, const Vec3d& to) {
  Mat4d matrix = turn;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) matrix.m[r][c] *= scale;
    matrix.m[r][3] = to[r];
  }
  return matrix;
}

TriangleMesh WriteMesh(const std::vector<TaggedBody>& bodies, const std::vector<Material>& materials) {
  TriangleMesh mesh;
  auto names = std::make_shared<SceneNames>();
  bool colors = false;
  for (const TaggedBody& tagged : bodies) {
    MeshPart run;
    run.first_triangle = mesh.triangles.size();
    run.triangle_count = tagged.body.triangles.size();
    run.first_vertex = mesh.positions.size();
    run.vertex_count = tagged.body.positions.size();
    run.material = tagged.material;
    run.mesh = tagged.mesh;
    run.node = tagged.node;
    run.primitive = tagged.primitive;
    run.has_colors = tagged.colors;
    colors = colors || tagged.colors;
    mesh.parts.push_back(run);
    const auto first = uint32_t(mesh.positions.size());
    mesh.positions.insert(mesh.positions.end(), tagged.body.positions.begin(), tagged.body.positions.end());
    for (const auto& t : tagged.body.triangles) mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    mesh.node_count = std::max(mesh.node_count, run.node + 1);
    mesh.mesh_count = std::max(mesh.mesh_count, run.mesh + 1);
  }
  for (size_t b = 0; b < bodies.size() && colors; ++b) {
    const float grey = bodies[b].colors ? 0.5f : 1.0f;
    mesh.colors.resize(mesh.colors.size() + bodies[b].body.positions.size(), {grey, grey, grey, 1});
  }
  names->nodes.resize(mesh.node_count);
  names->meshes.resize(mesh.mesh_count);
  for (const TaggedBody& tagged : bodies) {
    names->nodes[tagged.node] = tagged.node_name;
    names->meshes[tagged.mesh] = tagged.mesh_name;
  }
  for (uint32_t n = 0; n < mesh.node_count; ++n) {
    // A node of the same name before it stands for the nearest ancestor with a name.
    const auto same = std::find(names->nodes.begin(), names->nodes.end(), names->nodes[n]);
    names->named_by.push_back(uint32_t(same - names->nodes.begin()));
    if (names->named_by[n] != n) names->nodes[n].clear();
  }
  mesh.names = names;
  mesh.materials = materials;
  return mesh;
}

}  // namespace voxelpipe::testing
