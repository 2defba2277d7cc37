// Vertex shading, and the views through which shaders see the mesh.
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "cpu/parallel.h"
#include "cpu/run_state.h"
#include "shaders/material_views.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kGrain = 1 << 14;

void MakeViews(RunState& state) {
  const TriangleMesh& mesh = state.mesh;
  MaterialViews views = MakeMaterialViews(mesh);
  state.materials = std::move(views.materials);
  state.textures = std::move(views.textures);
  const int32_t default_material = int32_t(mesh.materials.size());
  for (const MeshPart& part : mesh.parts) {
    PartView view;
    view.first_triangle = part.first_triangle;
    view.material = part.material >= 0 && part.material < default_material ? part.material : default_material;
    view.mesh = part.mesh;
    view.has_normals = part.has_normals && !mesh.normals.empty();
    view.has_tangents = part.has_tangents && !mesh.tangents.empty();
    view.has_colors = part.has_colors && !mesh.colors.empty();
    for (int i = 0; i < 2; ++i) view.has_uv[i] = part.has_uv[i] && !mesh.uv[i].empty();
    state.parts.push_back(view);
  }
  if (state.parts.empty()) state.parts.push_back({.first_triangle = 0, .material = default_material});

  MeshView& view = state.view;
  view.positions = mesh.positions.data();
  view.normals = mesh.normals.empty() ? nullptr : mesh.normals.data();
  for (int i = 0; i < 2; ++i) view.uv[i] = mesh.uv[i].empty() ? nullptr : mesh.uv[i].data();
  view.tangents = mesh.tangents.empty() ? nullptr : mesh.tangents.data();
  view.colors = mesh.colors.empty() ? nullptr : mesh.colors.data();
  static_assert(sizeof(mesh.triangles[0]) == sizeof(uint32_t[3]));
  view.triangles = reinterpret_cast<const uint32_t(*)[3]>(mesh.triangles.data());
  view.parts = state.parts.data();
  view.materials = state.materials.data();
  view.textures = state.textures.data();
  for (const VertexAttribute& attribute : mesh.attributes) {
    state.attributes.push_back({attribute.values.data(), attribute.components});
  }
  view.attributes = state.attributes.data();
  view.attribute_count = uint32_t(state.attributes.size());
  view.vertex_count = mesh.positions.size();
  view.triangle_count = mesh.triangles.size();
  view.part_count = uint32_t(state.parts.size());
  view.material_count = uint32_t(state.materials.size());
  view.texture_count = uint32_t(state.textures.size());
}

absl::Status RunShader(RunState& state) {
  const BoundShader& shader = state.request.vertex_shader;
  const auto id = VertexShaderId(shader.id);
  if (id == VertexShaderId::kIdentity) return absl::OkStatus();
  const TriangleMesh& mesh = state.mesh;
  state.shaded_positions.resize(mesh.positions.size());
  state.shaded_normals.resize(mesh.normals.size());
  absl::Status s = ParallelChunks(int64_t(mesh.positions.size()), kGrain, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const Vec3f normal = mesh.normals.empty() ? Vec3f{} : mesh.normals[i];
      const ShadedVertex out = ShadeVertex(id, {mesh.positions[i], normal}, shader.params);
      state.shaded_positions[i] = out.position;
      if (!mesh.normals.empty()) state.shaded_normals[i] = out.normal;
    }
  });
  state.view.positions = state.shaded_positions.data();
  if (!mesh.normals.empty()) state.view.normals = state.shaded_normals.data();
  return s;
}

Box3d Grow(const Box3d& box, const Vec3d& p) {
  if (box.empty) return {p, p, false};
  Box3d grown = box;
  for (int a = 0; a < 3; ++a) {
    grown.min[a] = Min(box.min[a], p[a]);
    grown.max[a] = Max(box.max[a], p[a]);
  }
  return grown;
}

// Whether the box is quicker found over the vertices than over the triangles.
bool FewUnused(const TriangleMesh& mesh) {
  return mesh.unused_vertices && mesh.unused_vertices->size() < 64 + mesh.positions.size() / 8;
}

// The box of the used vertices, by the list of the others; false if one of them is not finite.
bool BoundsByVertices(const RunState& state, Box3d& box) {
  struct Bounds {
    Box3d box;
    bool finite = true;
  };
  const std::vector<uint32_t>& unused = *state.mesh.unused_vertices;
  const Bounds all = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, state.view.vertex_count, kGrain), Bounds{},
      [&](const tbb::blocked_range<uint64_t>& range, Bounds b) {
        auto skip = std::lower_bound(unused.begin(), unused.end(), range.begin());
        for (uint64_t begin = range.begin(); begin < range.end();) {
          const uint64_t end = skip == unused.end() ? range.end() : std::min<uint64_t>(range.end(), *skip);
          if (begin < end) {
            Box3d here{.empty = false};
            b.finite = state.kernels->bounds(state.view.positions, int64_t(begin), int64_t(end), here.min, here.max) &&
                       b.finite;
            b.box = Grow(Grow(b.box, here.min), here.max);
          }
          begin = end + 1;
          if (skip != unused.end()) ++skip;
        }
        return b;
      },
      [](const Bounds& a, const Bounds& b) {
        return Bounds{b.box.empty ? a.box : Grow(Grow(a.box, b.box.min), b.box.max), a.finite && b.finite};
      });
  box = all.box;
  return all.finite;
}

// The box of the vertices that triangles use.
absl::StatusOr<Box3d> BoundsOfUsed(const RunState& state) {
  const MeshView& view = state.view;
  // The first bad vertex by index, so that the message does not depend on the schedule.
  std::atomic<uint64_t> bad{UINT64_MAX};
  const Box3d box = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, view.triangle_count, kGrain), Box3d{},
      [&](const tbb::blocked_range<uint64_t>& range, Box3d b) {
        for (uint64_t t = range.begin(); t < range.end(); ++t) {
          for (const uint32_t v : view.triangles[t]) {
            const Vec3d& p = view.positions[v];
            if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) {
              b = Grow(b, p);
            } else {
              uint64_t seen = bad.load(std::memory_order_relaxed);
              while (v < seen && !bad.compare_exchange_weak(seen, v)) {}
            }
          }
        }
        return b;
      },
      [](const Box3d& a, const Box3d& b) { return b.empty ? a : Grow(Grow(a, b.min), b.max); });
  if (bad.load() != UINT64_MAX) {
    return absl::InvalidArgumentError(
        absl::StrCat(DescribeVertex(state.mesh, bad.load()), ": the position is not finite after the vertex shader"));
  }
  return box;
}

// The sums of MeshExtent. Reduced in a fixed order, so that the plan does not depend on the schedule.
void MeasureSurface(const MeshView& view, MeshExtent& extent) {
  struct Sums {
    Vec3d area{}, width{};
  };
  const Sums sums = tbb::parallel_deterministic_reduce(
      tbb::blocked_range<uint64_t>(0, view.triangle_count, kGrain), Sums{},
      [&](const tbb::blocked_range<uint64_t>& range, Sums s) {
        for (uint64_t t = range.begin(); t < range.end(); ++t) {
          const uint32_t* v = view.triangles[t];
          const Vec3d &a = view.positions[v[0]], &b = view.positions[v[1]], &c = view.positions[v[2]];
          const Vec3d n = Cross(b - a, c - a);
          for (int i = 0; i < 3; ++i) {
            s.area[i] += 0.5 * Abs(n[i]);
            s.width[i] += Max(a[i], Max(b[i], c[i])) - Min(a[i], Min(b[i], c[i]));
          }
        }
        return s;
      },
      [](const Sums& a, const Sums& b) {
        return Sums{a.area + b.area, a.width + b.width};
      });
  extent.projected_area = sums.area;
  extent.width = sums.width;
}

}  // namespace

std::string DescribeVertex(const TriangleMesh& mesh, uint64_t vertex) {
  for (const MeshPart& part : mesh.parts) {
    if (vertex >= part.first_vertex && vertex < part.first_vertex + part.vertex_count) {
      return absl::StrCat("node ", part.node, ", mesh ", part.mesh, ", primitive ", part.primitive, ", vertex ",
                          vertex - part.first_vertex);
    }
  }
  return absl::StrCat("vertex ", vertex);
}

absl::StatusOr<MeshExtent> VertexShade(RunState& state) {
  MakeViews(state);
  if (absl::Status s = RunShader(state); !s.ok()) return s;
  const MeshView& view = state.view;
  MeshExtent extent;
  if (!FewUnused(state.mesh) || !BoundsByVertices(state, extent.box)) {
    absl::StatusOr<Box3d> box = BoundsOfUsed(state);
    if (!box.ok()) return box.status();
    extent.box = *box;
  }
  for (int a = 0; a < 3; ++a) {  // -0 and +0 are one corner, whichever thread saw it first
    extent.box.min[a] += 0.0;
    extent.box.max[a] += 0.0;
  }
  if (state.request.request.result != ResultKind::kDense) MeasureSurface(view, extent);
  return extent;
}

}  // namespace voxelpipe::cpu
