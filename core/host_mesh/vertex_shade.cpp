// Vertex shading, and the views through which shaders read the mesh.
#include "host_mesh/vertex_shade.h"

#include <hwy/highway.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <memory>

#include "absl/strings/str_cat.h"
#include "base/long_loops.h"
#include "base/parallel.h"
#include "host_mesh/order_parts.h"
#include "mesh/views/material_views.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

constexpr int64_t kGrain = 1 << 14;
constexpr char kWhat[] = "the mesh's posed parts";

// The numbers of a parameter that the host reads itself; null if it is not given.
const std::vector<double>* Given(const ShaderCall& call, const char* name) {
  const auto found = call.parameters.find(name);
  return found == call.parameters.end() ? nullptr : &found->second;
}

// The motions of the placed meshes; empty if none has one.
std::vector<MotionRun> MotionsOf(const TriangleMesh& mesh) {
  std::vector<MotionRun> runs;
  if (!HasMotions(mesh)) return runs;
  runs.reserve(mesh.placed.size());
  for (const PlacedEntry& placed : mesh.placed) {
    if (placed.first_part == mesh.parts.size()) break;  // this mesh and those behind it have no vertices
    MotionRun run{mesh.parts[placed.first_part].first_vertex, {}};
    if (placed.motion) {
      const Vec3d numbers[] = {placed.motion->linear, placed.motion->angular, placed.motion->center};
      for (int i = 0; i < RigidMotion::kParameters; ++i) run.parameters[i] = numbers[i / 3][i % 3];
    }
    runs.push_back(run);
  }
  return runs;
}

// True if the call's parameters, or motions of placed meshes, give a velocity; otherwise there is no velocity array.
bool GivesVelocities(const BoundRequest& request, const HostMesh& state) {
  if (!state.motions.empty()) return true;
  for (const char* name : {"linear_velocity", "angular_velocity", "dt"}) {
    const std::vector<double>* given = Given(request.request.vertex_shader, name);
    if (given != nullptr && std::any_of(given->begin(), given->end(), [](double v) { return v != 0; })) return true;
  }
  return false;
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

// True if the box is found faster over the vertices than over the triangles.
bool FewUnused(const TriangleMesh& mesh) {
  return mesh.unused_vertices && mesh.unused_vertices->size() < 64 + mesh.positions.size() / 8;
}

struct Bounds {
  Box3d box;
  bool finite = true;
};

// Of positions [begin, end), at least one. If one is not finite, the box is undefined; so it may be beyond 10^300.
Bounds BoundsOf(const Vec3d* positions, uint64_t begin, uint64_t end) {
  namespace hn = hwy::HWY_NAMESPACE;
  static_assert(sizeof(Vec3d) == 3 * sizeof(double));
  // Two vertices are three vectors: x y, z x, y z. Compilers make none of minima in doubles.
  constexpr size_t kLanes = 2, kPair = 3 * kLanes;
  const hn::FixedTag<double, kLanes> d;
  const double* p = &positions[begin].x;
  double pair[kPair];  // twice the same vertex
  const auto twice = [&](const Vec3d& v) {
    for (size_t i = 0; i < kPair; ++i) pair[i] = v[int(i % 3)];
    return pair;
  };
  twice(positions[begin]);
  auto min0 = hn::LoadU(d, pair), min1 = hn::LoadU(d, pair + 2), min2 = hn::LoadU(d, pair + 4);
  auto max0 = min0, max1 = min1, max2 = min2;
  auto sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0;  // finite while all are
  const auto add = [&](const double* at) {
    const auto v0 = hn::LoadU(d, at), v1 = hn::LoadU(d, at + 2), v2 = hn::LoadU(d, at + 4);
    min0 = hn::Min(min0, v0);
    min1 = hn::Min(min1, v1);
    min2 = hn::Min(min2, v2);
    max0 = hn::Max(max0, v0);
    max1 = hn::Max(max1, v1);
    max2 = hn::Max(max2, v2);
    sum0 = hn::Add(sum0, v0);
    sum1 = hn::Add(sum1, v1);
    sum2 = hn::Add(sum2, v2);
  };
  uint64_t left = end - begin;
  for (; left >= 4; left -= 4) {
    add(p);
    add(p + kPair);
    p += 2 * kPair;
  }
  for (; left > 0; --left) add(twice(positions[end - left]));
  double least[kPair], most[kPair], sums[kLanes];
  hn::StoreU(min0, d, least);
  hn::StoreU(min1, d, least + 2);
  hn::StoreU(min2, d, least + 4);
  hn::StoreU(max0, d, most);
  hn::StoreU(max1, d, most + 2);
  hn::StoreU(max2, d, most + 4);
  hn::StoreU(hn::Add(sum0, hn::Add(sum1, sum2)), d, sums);
  Bounds out{{{}, {}, false}, std::isfinite(sums[0]) && std::isfinite(sums[1])};
  for (int a = 0; a < 3; ++a) {
    out.box.min[a] = Min(least[a], least[a + 3]);
    out.box.max[a] = Max(most[a], most[a + 3]);
  }
  return out;
}

// The box of the used vertices, given the list of unused ones; false if a used one may not be finite, or the job ended.
bool BoundsByVertices(const HostMesh& state, Box3d& box) {
  const std::vector<uint32_t>& unused = *state.mesh.unused_vertices;
  const Bounds all = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, state.view.vertex_count, kGrain), Bounds{},
      [&](const tbb::blocked_range<uint64_t>& range, Bounds b) {
        if (!state.job.Check().ok()) return Bounds{{}, false};
        auto skip = std::lower_bound(unused.begin(), unused.end(), range.begin());
        for (uint64_t begin = range.begin(); begin < range.end();) {
          const uint64_t end = skip == unused.end() ? range.end() : std::min<uint64_t>(range.end(), *skip);
          if (begin < end) {
            const Bounds here = BoundsOf(state.view.positions, begin, end);
            b.finite = here.finite && b.finite;
            b.box = Grow(Grow(b.box, here.box.min), here.box.max);
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
absl::StatusOr<Box3d> BoundsOfUsed(const HostMesh& state) {
  const MeshView& view = state.view;
  // The first invalid vertex by index, so that the message does not depend on scheduling.
  std::atomic<uint64_t> bad{UINT64_MAX};
  const Box3d box = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, view.triangle_count, kGrain), Box3d{},
      [&](const tbb::blocked_range<uint64_t>& range, Box3d b) {
        if (!state.job.Check().ok()) return b;
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
  if (absl::Status over = state.job.Check(); !over.ok()) return over;
  if (bad.load() != UINT64_MAX) {
    return absl::InvalidArgumentError(
        absl::StrCat(DescribeVertex(state.mesh, bad.load()), ": the position is not finite after the vertex shader"));
  }
  return box;
}

// Triangles whose boxes lie beside the grid that the request gives. In: the box of them all.
uint64_t CountOutside(const HostMesh& state, const Box3d& box) {
  const MeshView& view = state.view;
  const GridWindow window = WindowOf(state.request.request.grid);
  if (box.empty || !window.known()) return 0;
  if (window.Misses(box.min, box.max)) return view.triangle_count;
  if (!window.Misses(box.min, box.min) && !window.Misses(box.max, box.max)) return 0;
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, view.triangle_count, kGrain), uint64_t{0},
      [&](const tbb::blocked_range<uint64_t>& range, uint64_t count) {
        if (!state.job.Check().ok()) return count;
        for (uint64_t t = range.begin(); t < range.end(); ++t) {
          const uint32_t* const v = view.triangles[t];
          const Vec3d &a = view.positions[v[0]], &b = view.positions[v[1]], &c = view.positions[v[2]];
          Vec3d min, max;
          for (int i = 0; i < 3; ++i) {
            min[i] = Min(a[i], Min(b[i], c[i]));
            max[i] = Max(a[i], Max(b[i], c[i]));
          }
          count += window.Misses(min, max);
        }
        return count;
      },
      std::plus<>());
}

}  // namespace

namespace {

// "'wheel', " if the part is one of several placed meshes.
std::string PlacedName(const TriangleMesh& mesh, uint64_t part) {
  if (mesh.placed.size() < 2) return "";
  const auto behind = std::upper_bound(mesh.placed.begin(), mesh.placed.end(), part,
                                       [](uint64_t p, const PlacedEntry& placed) { return p < placed.first_part; });
  return absl::StrCat("'", std::prev(behind)->name, "', ");
}

}  // namespace

std::string DescribeVertex(const TriangleMesh& mesh, uint64_t vertex) {
  for (const MeshPart& part : mesh.parts) {
    if (vertex >= part.first_vertex && vertex < part.first_vertex + part.vertex_count) {
      return absl::StrCat(PlacedName(mesh, uint64_t(&part - mesh.parts.data())), "node ", part.node, ", mesh ",
                          part.mesh, ", primitive ", part.primitive, ", vertex ", vertex - part.first_vertex);
    }
  }
  return absl::StrCat("vertex ", vertex);
}

void MakeViews(HostMesh& state) {
  const TriangleMesh& mesh = state.mesh;
  MaterialViews views = MakeMaterialViews(mesh);
  state.materials = std::move(views.materials);
  state.textures = std::move(views.textures);
  const int32_t default_material = int32_t(mesh.materials.size());
  const PartList* const list = state.request.parts.get();
  for (size_t run = 0; run < mesh.parts.size(); ++run) {
    const MeshPart& part = mesh.parts[run];
    PartView view;
    if (list != nullptr && !list->parts.empty()) view.label = list->parts[list->of_run[run]].label;
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
    state.attributes.push_back({attribute.values.data(), attribute.components, uint32_t(attribute.runs.size()),
                                attribute.runs.empty() ? nullptr : attribute.runs.data()});
  }
  view.attributes = state.attributes.data();
  view.attribute_count = uint32_t(state.attributes.size());
  view.vertex_count = mesh.positions.size();
  view.triangle_count = mesh.triangles.size();
  view.part_count = uint32_t(state.parts.size());
  view.material_count = uint32_t(state.materials.size());
  view.texture_count = uint32_t(state.textures.size());
  state.motions = MotionsOf(mesh);
}

absl::StatusOr<PosedMesh> MakePose(const HostMesh& state) {
  PosedMesh posed;
  const BoundShader& shader = state.request.vertex_shader;
  const bool morph = VertexShaderId(shader.id) == VertexShaderId::kMorph;
  if (!morph && VertexShaderId(shader.id) != VertexShaderId::kSkin) return posed;
  const ShaderCall& call = state.request.request.vertex_shader;
  const auto error = [&](const absl::Status& why) {
    return absl::Status(why.code(),
                        absl::StrCat("vertex shader '", shader.info->name, "': ", std::string(why.message())));
  };
  PoseQuery query;
  query.nodes = !morph;
  const std::vector<double>*animation = Given(call, "animation"), *time = Given(call, "time");
  const std::vector<double>* weights = Given(call, "weights");
  if (animation != nullptr || time != nullptr) query.animation = animation == nullptr ? 0u : uint32_t(animation->at(0));
  if (time != nullptr) query.time = time->at(0);
  if (weights != nullptr) query.weights = *weights;
  if (query.animation && query.weights) {
    return error(absl::InvalidArgumentError("weights are given either by `weights` or by an animation, not by both"));
  }
  const double dt = shader.params.value[0];
  if (dt > 0 && !query.animation) return error(absl::InvalidArgumentError("dt needs a time"));
  if (!query.animation && !query.weights) return posed;
  if (state.mesh.placed.size() > 1 && state.mesh.rig == nullptr) {
    return error(absl::InvalidArgumentError(
        "of several placed meshes each must have animations or morph targets, and one has none"));
  }
  const Rig empty;
  const Rig& rig = state.mesh.rig == nullptr ? empty : *state.mesh.rig;
  auto pose = EvaluatePoseFor(state.job, rig, query);
  if (!pose.ok()) return error(pose.status());
  posed.pose = *std::move(pose);
  if (dt > 0) {
    query.time += dt;
    auto later = EvaluatePoseFor(state.job, rig, query);
    if (!later.ok()) return error(later.status());
    posed.later = *std::move(later);
  }
  constexpr size_t kPartsAStep = 4096;  // between two checks of the job
  constexpr uint64_t kPartBytes = sizeof(PosedPartView) + sizeof(std::vector<MorphTargetView>);
  posed.memory = MemoryCharge(&MemoryOf(state.job));
  if (absl::Status s = posed.memory.Grow(rig.parts.size(), 2 * kPartBytes, kWhat); !s.ok()) return s;
  posed.targets.resize(rig.parts.size());
  posed.parts.reserve(rig.parts.size());
  for (size_t i = 0; i < rig.parts.size(); ++i) {
    if (i % kPartsAStep == 0) {
      if (absl::Status s = state.job.Check(); !s.ok()) return s;
    }
    const Primitive& primitive = *rig.parts[i].primitive;
    if (primitive.morph != nullptr) {
      if (absl::Status s = state.job.Check(); !s.ok()) return s;
      absl::Status s = posed.memory.Grow(primitive.morph->targets.size(), 2 * sizeof(MorphTargetView), kWhat);
      if (!s.ok()) return s;
    }
    PosedPartView view;
    view.rest = RestView(primitive, posed.targets[i]);
    view.pose = posed.pose->parts[i];
    view.later = posed.later == nullptr ? view.pose : posed.later->parts[i];
    posed.parts.push_back(view);
  }
  return posed;
}

VertexWork WorkOf(const HostMesh& state, const PosedMesh& posed) {
  const auto id = VertexShaderId(state.request.vertex_shader.id);
  const bool poses = id == VertexShaderId::kMorph || id == VertexShaderId::kSkin;
  VertexWork work;
  work.places = id != VertexShaderId::kIdentity && !(poses && posed.parts.empty());
  work.moves = GivesVelocities(state.request, state);
  return work;
}

absl::Status ShadeVertices(HostMesh& state) {
  const BoundShader& shader = state.request.vertex_shader;
  const auto id = VertexShaderId(shader.id);
  absl::StatusOr<PosedMesh> posed = MakePose(state);
  if (!posed.ok()) return posed.status();
  const VertexWork work = WorkOf(state, *posed);
  const bool same = !work.places, moves = work.moves;
  if (!work.any()) return absl::OkStatus();
  const TriangleMesh& mesh = state.mesh;
  if (!same) {
    absl::Status over = Resize(state.job, state.shaded_positions, mesh.positions.size());
    if (over.ok()) over = Resize(state.job, state.shaded_normals, mesh.normals.size());
    if (over.ok()) over = Resize(state.job, state.shaded_tangents, mesh.tangents.size());
    if (!over.ok()) return over;
  }
  if (moves) {
    if (absl::Status over = Resize(state.job, state.velocities, mesh.positions.size()); !over.ok()) return over;
  }
  absl::Status s = ParallelChunks(int64_t(mesh.positions.size()), kGrain, state.job, [&](int64_t begin, int64_t end) {
    const auto behind = std::upper_bound(mesh.parts.begin(), mesh.parts.end(), uint64_t(begin),
                                         [](uint64_t v, const MeshPart& p) { return v < p.first_vertex; });
    size_t part = size_t(std::max<ptrdiff_t>(1, behind - mesh.parts.begin()) - 1);
    for (int64_t i = begin; i < end; ++i) {
      const uint64_t v = uint64_t(i);
      VertexInput in;
      in.flat.position = mesh.positions[v];
      if (!mesh.normals.empty()) in.flat.normal = mesh.normals[v];
      if (!mesh.tangents.empty()) in.flat.tangent = mesh.tangents[v];
      if (!posed->parts.empty()) {
        while (v >= mesh.parts[part].first_vertex + mesh.parts[part].vertex_count) ++part;
        in.posed = &posed->parts[part];
        in.vertex = v - mesh.parts[part].first_vertex;
      }
      ShadedVertex out = ShadeVertex(id, in, shader.params);
      if (!state.motions.empty()) AddMotion(state.motions.data(), uint32_t(state.motions.size()), v, out);
      if (moves) state.velocities[v] = {float(out.velocity.x), float(out.velocity.y), float(out.velocity.z)};
      if (same) continue;
      state.shaded_positions[v] = out.position;
      if (!mesh.normals.empty()) state.shaded_normals[v] = out.normal;
      if (!mesh.tangents.empty()) state.shaded_tangents[v] = out.tangent;
    }
  });
  if (moves) state.view.velocities = state.velocities.data();
  if (same) return s;
  state.view.positions = state.shaded_positions.data();
  if (!mesh.normals.empty()) state.view.normals = state.shaded_normals.data();
  if (!mesh.tangents.empty()) state.view.tangents = state.shaded_tangents.data();
  return s;
}

absl::StatusOr<MeshExtent> MeasureMesh(const HostMesh& state) {
  MeshExtent extent;
  if (!FewUnused(state.mesh) || !BoundsByVertices(state, extent.box)) {
    absl::StatusOr<Box3d> box = BoundsOfUsed(state);
    if (!box.ok()) return box.status();
    extent.box = *box;
  }
  for (int a = 0; a < 3; ++a) {  // -0 and +0 are the same corner for every order of threads
    extent.box.min[a] += 0.0;
    extent.box.max[a] += 0.0;
  }
  extent.triangles_outside = CountOutside(state, extent.box);
  if (absl::Status over = state.job.Check(); !over.ok()) return over;
  extent.held_bytes = state.shaded_positions.size() * sizeof(Vec3d) + state.shaded_normals.size() * sizeof(Vec3f) +
                      state.shaded_tangents.size() * sizeof(Vec4f) + state.velocities.size() * sizeof(Vec3f);
  return extent;
}

absl::StatusOr<MeshExtent> ShadeHostMesh(HostMesh& state) {
  MakeViews(state);
  if (FillsParts(state.request.request)) {
    if (absl::Status s = OrderByParts(state); !s.ok()) return s;
  }
  if (absl::Status s = ShadeVertices(state); !s.ok()) return s;
  return MeasureMesh(state);
}

}  // namespace voxelpipe
