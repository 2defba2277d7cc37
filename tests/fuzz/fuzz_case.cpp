#include "fuzz/fuzz_case.h"

#include <cmath>
#include <vector>

#include "fuzz/byte_source.h"
#include "grid/voxel_format.h"
#include "shaders/catalog.h"

namespace voxelpipe::fuzz {
namespace {

Vec3d Point(ByteSource& in, double lo, double hi) {
  const double x = in.Between(lo, hi), y = in.Between(lo, hi);
  return {x, y, in.Between(lo, hi)};
}

// Corners, faces and centres of voxels, where every comparison ties.
Vec3d LatticePoint(ByteSource& in, double extent) {
  Vec3d p;
  for (int a = 0; a < 3; ++a) p[a] = 0.5 * std::floor(in.Between(-2, 2 * extent + 2));
  return p;
}

// Positions in index space; the grid's placement is applied afterwards.
class MeshMaker {
 public:
  MeshMaker(ByteSource& in, double extent) : in_(in), extent_(extent) {}

  TriangleMesh Make() {
    const int shapes = 1 + in_.Below(7);
    for (int i = 0; i < shapes; ++i) AddShape();
    AddAttributes();
    AddParts();
    return std::move(mesh_);
  }

 private:
  void AddTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto v = uint32_t(mesh_.positions.size());
    mesh_.positions.insert(mesh_.positions.end(), {a, b, c});
    mesh_.triangles.push_back({v, v + 1, v + 2});
  }

  void AddTetrahedron(double radius) {
    const Vec3d centre = Point(in_, 0, extent_);
    const auto v = uint32_t(mesh_.positions.size());
    for (int i = 0; i < 4; ++i) mesh_.positions.push_back(centre + Point(in_, -radius, radius));
    mesh_.triangles.push_back({v, v + 2, v + 1});
    mesh_.triangles.push_back({v, v + 1, v + 3});
    mesh_.triangles.push_back({v + 1, v + 2, v + 3});
    mesh_.triangles.push_back({v, v + 3, v + 2});
  }

  // A box along an axis, open at one end: reached by a flood through that end alone.
  void AddTube() {
    const int axis = in_.Below(3), u = (axis + 1) % 3, w = (axis + 2) % 3;
    const Vec3d from = Point(in_, 0, 5);
    const double length = in_.Chance(2) ? extent_ : 30 + in_.Below(40);  // over the border of words
    const double wide = 3 + in_.Below(5), high = 3 + in_.Below(5);
    const auto v = static_cast<uint32_t>(mesh_.positions.size());
    for (uint32_t i = 0; i < 8; ++i) {
      Vec3d p = from;
      p[axis] += (i & 4) != 0 ? length : 0;
      p[u] += (i & 1) != 0 ? wide : 0;
      p[w] += (i & 2) != 0 ? high : 0;
      mesh_.positions.push_back(p);
    }
    const uint32_t closed = in_.Chance(2) ? 0 : 4;
    const uint32_t quads[5][4] = {
        {0, 1, 4, 5}, {2, 3, 6, 7}, {0, 2, 4, 6}, {1, 3, 5, 7}, {closed, closed + 1, closed + 2, closed + 3}};
    for (const auto& q : quads) {
      mesh_.triangles.push_back({v + q[0], v + q[1], v + q[2]});
      mesh_.triangles.push_back({v + q[2], v + q[1], v + q[3]});
    }
  }

  void AddShape() {
    const Vec3d a = Point(in_, -1, extent_ + 1);
    switch (in_.Below(15)) {
      case 0: return AddTriangle(a, a + Point(in_, -1, 1), a + Point(in_, -1, 1));      // about a voxel
      case 1: return AddTriangle(a, a + Point(in_, -8, 8), a + Point(in_, -8, 8));      // some voxels
      case 2: return AddTriangle(a, a + Point(in_, -40, 40), a + Point(in_, -40, 40));  // about the largest in float
      case 3: {  // sliver, of any thickness down to nothing
        const Vec3d b = a + Point(in_, -12, 12);
        const double thickness = std::ldexp(1.0, -in_.Below(48));
        return AddTriangle(a, b, a + (b - a) * in_.Between(-0.5, 1.5) + Point(in_, -thickness, thickness));
      }
      case 4: {  // collinear
        const Vec3d step = LatticePoint(in_, 4) - LatticePoint(in_, 4);
        const Vec3d from = LatticePoint(in_, extent_);
        return AddTriangle(from, from + step * 2.0, from + step);
      }
      case 5: return AddTriangle(a, a, a);
      case 6: {  // huge, through the grid
        const double far = std::ldexp(extent_, in_.Chance(4) ? in_.Below(34) : in_.Below(12));
        return AddTriangle(Point(in_, -far, far), Point(in_, -far, far), a);
      }
      case 7: return AddTriangle(LatticePoint(in_, extent_), LatticePoint(in_, extent_), LatticePoint(in_, extent_));
      case 8: {  // in a lattice plane
        Vec3d v[3] = {LatticePoint(in_, extent_), LatticePoint(in_, extent_), LatticePoint(in_, extent_)};
        const int axis = in_.Below(3);
        v[1][axis] = v[2][axis] = v[0][axis];
        return AddTriangle(v[0], v[1], v[2]);
      }
      case 9: {  // outside, touching nothing or the border
        const Vec3d b = Point(in_, extent_, 2 * extent_);
        return AddTriangle(b, b + Point(in_, -2, 2), b + Point(in_, -2, 2));
      }
      case 10: {  // a vertex used before, or the whole triangle again
        if (mesh_.triangles.empty()) return AddTriangle(a, a + Vec3d{1, 0, 0}, a + Vec3d{0, 1, 0});
        const std::array<uint32_t, 3> old = mesh_.triangles[size_t(in_.Below(int(mesh_.triangles.size())))];
        if (in_.Chance(2)) {
          mesh_.triangles.push_back({old[1], old[0], old[2]});
          return;
        }
        mesh_.positions.push_back(a);
        mesh_.triangles.push_back({old[0], old[2], uint32_t(mesh_.positions.size() - 1)});
        return;
      }
      case 11: {  // far below a voxel
        const double size = std::ldexp(1.0, -in_.Below(40));
        return AddTriangle(a, a + Point(in_, -size, size), a + Point(in_, -size, size));
      }
      case 12: return AddTetrahedron(extent_);
      case 13: return AddTube();
      default: return AddTetrahedron(2);
    }
  }

  void AddAttributes() {
    const size_t count = mesh_.positions.size();
    const auto unit = [&] { return float(in_.Signed()); };
    if (in_.Chance(2)) {
      for (size_t i = 0; i < count; ++i) {
        const float x = unit(), y = unit();
        mesh_.normals.push_back({x, y, unit()});
      }
    }
    if (in_.Chance(4)) {
      for (size_t i = 0; i < count; ++i) {
        const float x = unit(), y = unit();
        mesh_.tangents.push_back({x, y, unit(), 1});
      }
    }
    for (auto& uv : mesh_.uv) {
      if (!in_.Chance(4)) continue;
      for (size_t i = 0; i < count; ++i) {
        const float u = unit();
        uv.push_back({u, unit()});
      }
    }
    if (in_.Chance(2)) {
      for (size_t i = 0; i < count; ++i) {
        const float r = unit(), g = unit(), b = unit();
        mesh_.colors.push_back({r, g, b, unit()});
      }
    }
    VertexAttribute attribute;
    attribute.name = "_A";
    attribute.components = 1 + in_.Below(4);
    const bool flat = in_.Chance(2);  // one value a triangle, zeros of both signs among them
    const float values[] = {0.0f, -0.0f, 1.0f, -1.0f};
    for (size_t i = 0; i < count; ++i) {
      const int chosen = flat && i % 3 == 0 ? in_.Below(4) : 0;
      for (int c = 0; c < attribute.components; ++c) {
        const size_t before = attribute.values.size() - size_t(i == 0 ? 0 : attribute.components);
        attribute.values.push_back(!flat ? unit() : i % 3 == 0 ? values[chosen] : attribute.values[before]);
      }
    }
    mesh_.attributes.push_back(attribute);
  }

  void AddParts() {
    MeshPart part;
    part.triangle_count = mesh_.triangles.size();
    part.vertex_count = mesh_.positions.size();
    part.has_normals = !mesh_.normals.empty();
    part.has_tangents = !mesh_.tangents.empty();
    part.has_colors = !mesh_.colors.empty();
    for (int i = 0; i < 2; ++i) part.has_uv[i] = !mesh_.uv[i].empty();
    if (in_.Chance(2)) {
      Material material;
      material.base_color_factor = {0.5f, 0.25f, 1, float(in_.Between(0, 1))};
      material.emissive_factor = {1, 0, 0.125f};
      material.metallic_factor = 0.75f;
      material.alpha_mode = AlphaMode(in_.Below(3));
      material.alpha_cutoff = 0.25f;
      mesh_.materials.push_back(material);
      part.material = 0;
    }
    mesh_.parts.push_back(part);
  }

  ByteSource& in_;
  const double extent_;
  TriangleMesh mesh_;
};

double Number(ByteSource& in) {
  switch (in.Below(6)) {
    case 0: return 0;
    case 1: return 1;
    case 2: return -0.0;
    case 3: return std::ldexp(in.Signed(), in.Below(40));
    case 4: return std::ldexp(in.Signed(), -in.Below(40));
    default: return in.Between(-300, 300);
  }
}

ShaderCall MakeShader(ByteSource& in) {
  std::vector<const ShaderInfo*> fragment;
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage == ShaderStage::kFragment) fragment.push_back(&info);
  }
  const ShaderInfo& info = *fragment[size_t(in.Below(int(fragment.size())))];
  ShaderCall call;
  call.name = info.name;
  if (info.name == "attribute") call.text["name"] = "_A";
  if (info.name == "constant") call.parameters["value"] = {Number(in), Number(in), Number(in), Number(in)};
  if (info.name == "uv") call.parameters["set"] = {double(in.Below(2))};
  if (info.name == "checker") {
    call.parameters["size"] = {double(1 + in.Below(9))};
    call.parameters["odd"] = {Number(in)};
  }
  return call;
}

TargetSpec MakeTarget(ByteSource& in) {
  TargetSpec target;
  target.format = VoxelFormat(in.Below(6));
  if (target.format != VoxelFormat::kBit) target.components = 1 + in.Below(4);
  do {
    target.blend = Blend(in.Below(9));  // kOr once the bytes are spent
    if (in.spent()) target.blend = target.format == VoxelFormat::kBit ? Blend::kOr : Blend::kReplace;
  } while (!CheckBlend(target.format, target.blend).ok());
  target.shader = in.Chance(3) ? ShaderCall{"occupancy", {}} : MakeShader(in);
  if (in.Chance(3)) target.quantum = std::ldexp(1.0, in.Below(60) - 40);
  const bool integer =
      target.format == VoxelFormat::kU8 || target.format == VoxelFormat::kU16 || target.format == VoxelFormat::kU32;
  if (integer && in.Chance(2)) target.scale = Number(in);
  if (in.Chance(2)) target.clear = Number(in);
  if (in.Chance(2)) {
    target.fill_values = {Number(in)};
    if (in.Chance(2)) {
      while (target.fill_values.size() < size_t(target.components)) target.fill_values.push_back(Number(in));
    }
  }
  const bool linear = target.blend == Blend::kCount || target.blend == Blend::kAnd || target.blend == Blend::kOr;
  const bool colour = target.shader.name == "constant" || target.shader.name == "base_color" ||
                      target.shader.name == "color" || target.shader.name == "emissive";
  if (target.format == VoxelFormat::kU8 && colour && !linear && !target.scale) {
    target.encoding = Encoding(in.Below(2));
  }
  return target;
}

}  // namespace

FuzzCase MakeCase(std::span<const uint8_t> bytes) {
  ByteSource in(bytes);
  FuzzCase made;
  VoxelizeRequest& request = made.request;
  request.coverage = Coverage(in.Below(4));
  request.result = ResultKind(in.Below(3));
  if (request.result != ResultKind::kBuckets) {
    request.fill = Fill(in.Below(4));
    if (request.coverage == Coverage::kNone && !CastsLines(request.fill)) request.fill = Fill::kNonzero;
  } else if (request.coverage == Coverage::kCenter || request.coverage == Coverage::kNone) {  // have none
    request.coverage = Coverage::kThin;
  }
  request.layout = Layout(in.Below(2));
  request.targets.clear();
  const int targets = 1 + in.Below(3);
  for (int i = 0; i < targets; ++i) request.targets.push_back(MakeTarget(in));

  // Beyond a word, a tile and a brick along each axis, but not along all three at once.
  const int shape = in.Below(4);
  std::array<int64_t, 3> dims{1 + in.Below(26), 1 + in.Below(26), 1 + in.Below(26)};
  if (shape < 3) {
    dims = {1 + in.Below(12), 1 + in.Below(12), 1 + in.Below(12)};
    dims[size_t(shape)] = 1 + in.Below(100);
  }
  const double extent = double(1 + in.Below(30));
  made.mesh = MeshMaker(in, extent).Make();
  Vec3d size{1, 1, 1}, origin{0, 0, 0};
  if (in.Chance(2)) {  // world space that rounds
    for (int a = 0; a < 3; ++a) size[a] = std::ldexp(1.0 + 0.1 * in.Below(10), in.Below(20) - 10);
    origin = Point(in, -100, 100);
  }
  for (Vec3d& p : made.mesh.positions) {
    p = {p.x * size.x + origin.x, p.y * size.y + origin.y, p.z * size.z + origin.z};
  }
  if (in.Chance(4)) {
    request.grid.resolution = 1 + in.Below(24);
    request.grid.fit = GridFit(in.Below(2));
    request.grid.padding = in.Below(3);
  } else {
    request.grid.dims = dims;
    request.grid.origin = origin;
    request.grid.voxel_size = size;
  }
  return made;
}

}  // namespace voxelpipe::fuzz
