// Source: glTF 2.0 specification, sections 3.5.2 (transformations), 3.7.3 (skins), 3.7.4 (instantiation);
// EXT_mesh_gpu_instancing.
#include "mesh/flatten.h"
#include "mesh/flatten_job.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <memory>
#include <new>
#include <string>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "base/long_loops.h"
#include "mesh/scene_names.h"
#include "mesh/placement.h"
#include "mesh/scene/pose.h"
#include "mesh/unused_vertices.h"

namespace voxelpipe {
namespace {

constexpr size_t kVertexGrain = 1 << 13;

// For each primitive the indices of its attributes in TriangleMesh::attributes.
using AttributeIds = std::unordered_map<const Primitive*, std::vector<uint32_t>>;

uint64_t SaturatingAdd(uint64_t a, uint64_t b) {
  return CheckedAdd(a, b).value_or(UINT64_MAX);
}
uint64_t SaturatingMul(uint64_t a, uint64_t b) {
  return CheckedMul(a, b).value_or(UINT64_MAX);
}

// Node indices of the scene, depth first, parents before children, children in file order.
std::vector<uint32_t> DepthFirst(const Scene& scene) {
  std::vector<uint32_t> order, stack(scene.roots.rbegin(), scene.roots.rend());
  while (!stack.empty()) {
    const uint32_t n = stack.back();
    stack.pop_back();
    order.push_back(n);
    const std::vector<uint32_t>& children = scene.nodes[n].children;
    stack.insert(stack.end(), children.rbegin(), children.rend());
  }
  return order;
}

// World transform of every node, also of those outside the scene: joints may live there.
std::vector<Mat4d> WorldTransforms(const Scene& scene) {
  std::vector<Mat4d> world(scene.nodes.size());
  std::vector<bool> has_parent(scene.nodes.size());
  for (const Node& node : scene.nodes) {
    for (const uint32_t child : node.children) has_parent[child] = true;
  }
  std::vector<uint32_t> stack;
  for (uint32_t n = 0; n < scene.nodes.size(); ++n) {
    world[n] = scene.nodes[n].local;
    if (!has_parent[n]) stack.push_back(n);
  }
  while (!stack.empty()) {
    const uint32_t n = stack.back();
    stack.pop_back();
    for (const uint32_t child : scene.nodes[n].children) {
      world[child] = Multiply(world[n], scene.nodes[child].local);
      stack.push_back(child);
    }
  }
  return world;
}

// True if a primitive puts anything into the mesh.
bool IsDrawn(const Primitive& primitive) {
  return !primitive.positions.empty() || !primitive.triangles.empty();
}

// One list a skin; incomplete, and not to be used, if the job ended.
std::vector<std::vector<Mat4d>> SkinningMatrices(const JobContext& job, const Scene& scene,
                                                 const std::vector<Mat4d>& world) {
  std::vector<std::vector<Mat4d>> skins(scene.skins.size());
  for (size_t s = 0; s < skins.size() && job.Check().ok(); ++s) {
    const Skin& skin = scene.skins[s];
    std::vector<Mat4d>& matrices = skins[s];
    matrices.reserve(skin.joints.size());
    for (size_t j = 0; j < skin.joints.size(); ++j) {
      matrices.push_back(Multiply(world[skin.joints[j]], skin.inverse_bind_matrices[j]));
    }
  }
  return skins;
}

bool IsSkinned(const Node& node, const Primitive& primitive, const std::vector<std::vector<Mat4d>>& skins) {
  return node.skin >= 0 && !primitive.joints[0].empty() && !primitive.weights[0].empty() && !skins[node.skin].empty();
}

// Totals over the primitives of one mesh.
struct MeshCounts {
  uint64_t triangles = 0, vertices = 0;
};

// One per mesh, so that nodes need not visit the primitives again.
std::vector<MeshCounts> CountMeshes(const Scene& scene) {
  std::vector<MeshCounts> counts(scene.meshes.size());
  for (size_t m = 0; m < counts.size(); ++m) {
    for (const Primitive& primitive : scene.meshes[m].primitives) {
      counts[m].triangles += primitive.triangles.size();
      counts[m].vertices += primitive.positions.size();
    }
  }
  return counts;
}

// Bytes of the transforms of nodes and joints while a scene is flattened.
uint64_t TransformBytes(const Scene& scene) {
  uint64_t bytes = scene.nodes.size() * (sizeof(Mat4d) + 4 * sizeof(uint32_t));
  for (const Skin& skin : scene.skins) bytes += sizeof(std::vector<Mat4d>) + skin.joints.size() * sizeof(Mat4d);
  return bytes + scene.meshes.size() * (sizeof(MeshCounts) + sizeof(std::vector<uint32_t>));
}

absl::Status CheckLimits(const Scene& scene, const std::vector<uint32_t>& order, const LoadLimits& limits) {
  const std::vector<MeshCounts> counts = CountMeshes(scene);
  uint64_t triangles = 0, vertices = 0, instances = 0;
  for (const uint32_t n : order) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    const uint64_t copies = std::max<uint64_t>(1, node.instances.size());
    instances = SaturatingAdd(instances, copies);
    const MeshCounts& mesh = counts[size_t(node.mesh)];
    triangles = SaturatingAdd(triangles, SaturatingMul(copies, mesh.triangles));
    vertices = SaturatingAdd(vertices, SaturatingMul(copies, mesh.vertices));
  }
  const auto exhausted = [](const char* what, uint64_t need, uint64_t limit) {
    return absl::ResourceExhaustedError(absl::StrCat("the scene has ", need, " ", what, ", the limit is ", limit));
  };
  if (instances > limits.max_instances) return exhausted("mesh instances", instances, limits.max_instances);
  if (triangles > limits.max_triangles) return exhausted("triangles after instancing", triangles, limits.max_triangles);
  // Indices are 32-bit.
  const uint64_t max_vertices = std::min<uint64_t>(limits.max_vertices, UINT32_MAX);
  if (vertices > max_vertices) return exhausted("vertices after instancing", vertices, max_vertices);
  return absl::OkStatus();
}

// Fills mesh.parts, and `placements` with as many. Both are charged to the job's memory: the parts to mesh.memory.
absl::Status Place(const JobContext& job, const Scene& scene, const std::vector<uint32_t>& order,
                   const std::vector<Mat4d>& world, const std::vector<std::vector<Mat4d>>& skins, MemoryCharge& charge,
                   std::vector<Placement>& placements, TriangleMesh& mesh) {
  std::vector<std::vector<uint32_t>> drawn(scene.meshes.size());  // primitives of each mesh
  for (size_t m = 0; m < drawn.size(); ++m) {
    const std::vector<Primitive>& primitives = scene.meshes[m].primitives;
    for (uint32_t i = 0; i < primitives.size(); ++i) {
      if (IsDrawn(primitives[i])) drawn[m].push_back(i);
    }
  }
  uint64_t count = 0;
  for (const uint32_t n : order) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    const uint64_t copies = std::max<uint64_t>(1, node.instances.size());
    count = SaturatingAdd(count, SaturatingMul(copies, drawn[size_t(node.mesh)].size()));
  }
  if (absl::Status full = charge.Grow(count, sizeof(Placement), "placing the scene's primitives"); !full.ok())
    return full;
  if (absl::Status full = mesh.memory->Grow(count, sizeof(MeshPart), "the mesh's parts"); !full.ok()) return full;
  placements.reserve(count);
  mesh.parts.reserve(count);
  uint64_t triangle = 0, vertex = 0;
  for (const uint32_t n : order) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0 || drawn[size_t(node.mesh)].empty()) continue;
    const std::vector<Primitive>& primitives = scene.meshes[node.mesh].primitives;
    for (size_t copy = 0; copy < std::max<size_t>(1, node.instances.size()); ++copy) {
      const Mat4d instance = node.instances.empty() ? world[n] : Multiply(world[n], node.instances[copy]);
      for (const uint32_t i : drawn[size_t(node.mesh)]) {
        if (placements.size() % kPlacementsAStep == 0) {
          if (absl::Status over = job.Check(); !over.ok()) return over;
        }
        const Primitive& primitive = primitives[i];
        Placement p;
        p.primitive = &primitive;
        if (!node.instances.empty()) p.instance = &node.instances[copy];
        if (IsSkinned(node, primitive, skins)) {  // the node's own transform is ignored
          p.joints = &skins[node.skin];
          p.mirrored = Determinant3(p.joints->front()) < 0;
        } else {
          p.world = instance;
          p.mirrored = Determinant3(instance) < 0;
        }
        MeshPart part;
        part.first_triangle = triangle;
        part.triangle_count = primitive.triangles.size();
        part.first_vertex = vertex;
        part.vertex_count = primitive.positions.size();
        part.material = primitive.material;
        part.mesh = uint32_t(node.mesh);
        part.node = n;
        part.primitive = i;
        part.has_normals = !primitive.normals.empty();
        part.has_tangents = !primitive.tangents.empty();
        part.has_colors = !primitive.colors.empty();
        for (int s = 0; s < 2; ++s) part.has_uv[s] = !primitive.uv[s].empty();
        triangle += part.triangle_count;
        vertex += part.vertex_count;
        mesh.parts.push_back(part);
        placements.push_back(p);
      }
    }
  }
  return absl::OkStatus();
}

bool Finite(const Vec3d& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

// Writes the vertices [begin, end) of one placement. Out: the first bad vertex, or SIZE_MAX.
size_t WriteVertices(const Placement& p, const MeshPart& part, size_t begin, size_t end, TriangleMesh& mesh) {
  const Primitive& primitive = *p.primitive;
  std::vector<MorphTargetView> none;
  const RestPrimitiveView rest = RestView(primitive, none);  // for the joints; the arrays here are morphed already
  for (size_t v = begin; v < end; ++v) {
    Mat4d m = p.world;
    if (p.joints != nullptr && !BlendJoints(rest, p.joints->data(), uint32_t(p.joints->size()), v, m)) return v;
    const size_t at = part.first_vertex + v;
    mesh.positions[at] = TransformPoint(m, PositionOf(primitive, v));
    if (!Finite(mesh.positions[at])) return v;
    if (part.has_normals) {
      const Vec3f& n = primitive.normals[v];
      mesh.normals[at] = UnitOrZero(TransformNormal(m, {n.x, n.y, n.z}));
    }
    if (part.has_tangents) {
      const Vec4f& t = primitive.tangents[v];
      const Vec3f unit = UnitOrZero(TransformVector(m, {t.x, t.y, t.z}));
      mesh.tangents[at] = {unit.x, unit.y, unit.z, p.mirrored ? -t.w : t.w};
    }
    for (int s = 0; s < 2; ++s) {
      if (part.has_uv[s]) mesh.uv[s][at] = primitive.uv[s][v];
    }
    if (part.has_colors) mesh.colors[at] = primitive.colors[v];
  }
  return SIZE_MAX;
}

// The position of the values of a vertex that has values.
uint64_t FirstValue(const VertexAttribute& attribute, uint64_t vertex) {
  const uint64_t wide = uint64_t(attribute.components);
  if (attribute.runs.empty()) return vertex * wide;
  const auto behind = std::upper_bound(attribute.runs.begin(), attribute.runs.end(), vertex,
                                       [](uint64_t v, const AttributeRun& run) { return v < run.first_vertex; });
  const AttributeRun& run = *std::prev(behind);
  return run.first_value + (vertex - run.first_vertex) * wide;
}

// The application-specific attributes of the vertices [begin, end) of one placement.
void WriteAttributes(const Placement& p, const MeshPart& part, const AttributeIds& ids, size_t begin, size_t end,
                     TriangleMesh& mesh) {
  if (p.primitive->attributes.empty()) return;
  const std::vector<uint32_t>& own = ids.at(p.primitive);
  for (size_t i = 0; i < own.size(); ++i) {
    const VertexAttribute& from = p.primitive->attributes[i];
    VertexAttribute& to = mesh.attributes[own[i]];
    const size_t narrow = size_t(from.components), wide = size_t(to.components);
    float* const first = to.values.data() + FirstValue(to, part.first_vertex);
    if (narrow == wide) {
      std::copy(from.values.begin() + ptrdiff_t(begin * wide), from.values.begin() + ptrdiff_t(end * wide),
                first + begin * wide);
      continue;
    }
    for (size_t v = begin; v < end; ++v) {
      std::copy_n(from.values.data() + v * narrow, narrow, first + v * wide);
      if (wide == 4) first[v * wide + 3] = 1;
    }
  }
}

void WriteTriangles(const Placement& p, const MeshPart& part, size_t begin, size_t end, TriangleMesh& mesh) {
  const uint32_t base = uint32_t(part.first_vertex);
  for (size_t t = begin; t < end; ++t) {
    std::array<uint32_t, 3> v = p.primitive->triangles[t];
    if (p.mirrored) std::swap(v[1], v[2]);
    mesh.triangles[part.first_triangle + t] = {base + v[0], base + v[1], base + v[2]};
  }
}

// For the mesh's parts; charged to mesh.memory. Incomplete, and not to be used, if the job ended.
absl::Status AllocateArrays(const JobContext& job, TriangleMesh& mesh) {
  uint64_t vertices = 0, triangles = 0;
  bool normals = false, tangents = false, colors = false, uv[2] = {false, false};
  for (const MeshPart& part : mesh.parts) {
    vertices += part.vertex_count;
    triangles += part.triangle_count;
    normals = normals || part.has_normals;
    tangents = tangents || part.has_tangents;
    colors = colors || part.has_colors;
    for (int s = 0; s < 2; ++s) uv[s] = uv[s] || part.has_uv[s];
  }
  uint64_t vertex_bytes = sizeof(Vec3d) + sizeof(uint8_t);  // with UnusedVertices' mark
  if (normals) vertex_bytes += sizeof(Vec3f);
  if (tangents) vertex_bytes += sizeof(Vec4f);
  if (colors) vertex_bytes += sizeof(Vec4f);
  for (int s = 0; s < 2; ++s) vertex_bytes += uv[s] ? sizeof(Vec2f) : 0;
  if (absl::Status full = mesh.memory->Grow(vertices, vertex_bytes, "the mesh's vertices"); !full.ok()) return full;
  if (absl::Status full = mesh.memory->Grow(triangles, sizeof(mesh.triangles[0]), "the mesh's triangles"); !full.ok()) {
    return full;
  }
  absl::Status over = Resize(job, mesh.positions, vertices);
  if (over.ok()) over = Resize(job, mesh.triangles, triangles);
  if (over.ok() && normals) over = Resize(job, mesh.normals, vertices);
  if (over.ok() && tangents) over = Resize(job, mesh.tangents, vertices);
  if (over.ok() && colors) over = Resize(job, mesh.colors, vertices, Vec4f{1, 1, 1, 1});
  for (int s = 0; s < 2; ++s) {
    if (over.ok() && uv[s]) over = Resize(job, mesh.uv[s], vertices);
  }
  return over;
}

// Lists the attributes of all primitives in the mesh, and maps those of each primitive to the list.
absl::Status NameAttributes(const JobContext& job, const std::vector<Placement>& placements, TriangleMesh& mesh,
                            AttributeIds& own) {
  std::unordered_map<std::string, uint32_t> ids;
  for (size_t i = 0; i < placements.size(); ++i) {
    if (i % kPlacementsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const Primitive& primitive = *placements[i].primitive;
    if (primitive.attributes.empty()) continue;
    const auto [place, first_time] = own.try_emplace(&primitive);
    if (!first_time) continue;
    for (const VertexAttribute& attribute : primitive.attributes) {
      const auto [id, fresh] = ids.try_emplace(attribute.name, uint32_t(mesh.attributes.size()));
      if (fresh) mesh.attributes.push_back({attribute.name, attribute.components, {}});
      int& widest = mesh.attributes[id->second].components;
      widest = std::max(widest, attribute.components);
      place->second.push_back(id->second);
    }
  }
  return absl::OkStatus();
}

// Adds the vertices of a part, which follow all vertices with the attribute so far.
void AddRun(const MeshPart& part, VertexAttribute& attribute) {
  const uint64_t end = part.first_vertex + part.vertex_count;
  if (!attribute.runs.empty() && attribute.runs.back().end_vertex == part.first_vertex) {
    attribute.runs.back().end_vertex = end;
    return;
  }
  uint64_t values = 0;
  if (!attribute.runs.empty()) {
    const AttributeRun& last = attribute.runs.back();
    values = last.first_value + (last.end_vertex - last.first_vertex) * uint64_t(attribute.components);
  }
  attribute.runs.push_back({part.first_vertex, end, values});
}

// Allocates the values of the vertices that have each attribute, charged to mesh.memory: linear in the primitives' own.
absl::Status AllocateAttributes(const JobContext& job, const std::vector<Placement>& placements,
                                const AttributeIds& own, TriangleMesh& mesh) {
  constexpr char kWhat[] = "merging the file's own vertex attributes";
  if (mesh.attributes.empty()) return absl::OkStatus();
  uint64_t values = 0, runs = 0;
  for (size_t i = 0; i < placements.size(); ++i) {
    const Primitive& primitive = *placements[i].primitive;
    if (primitive.attributes.empty()) continue;
    uint64_t components = 0;
    for (const uint32_t id : own.at(&primitive)) components += uint64_t(mesh.attributes[id].components);
    values = SaturatingAdd(values, SaturatingMul(components, mesh.parts[i].vertex_count));
    runs = SaturatingAdd(runs, primitive.attributes.size());
    if (absl::Status over = job.Check(); !over.ok()) return over;
  }
  if (absl::Status full = mesh.memory->Grow(values, sizeof(float), kWhat); !full.ok()) return full;
  // Twice: the lists grow by doubling.
  if (absl::Status full = mesh.memory->Grow(runs, 2 * sizeof(AttributeRun), kWhat); !full.ok()) return full;
  for (size_t i = 0; i < placements.size(); ++i) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const Primitive& primitive = *placements[i].primitive;
    if (primitive.attributes.empty() || mesh.parts[i].vertex_count == 0) continue;
    for (const uint32_t id : own.at(&primitive)) AddRun(mesh.parts[i], mesh.attributes[id]);
  }
  const uint64_t vertices = mesh.positions.size();
  for (VertexAttribute& attribute : mesh.attributes) {
    uint64_t size = 0;
    for (const AttributeRun& run : attribute.runs) size += (run.end_vertex - run.first_vertex);
    absl::Status over = Resize(job, attribute.values, size * uint64_t(attribute.components));
    if (!over.ok()) return over;
    if (size == vertices) attribute.runs.clear();             // all vertices have it
    if (size == 0) attribute.runs = {AttributeRun{0, 0, 0}};  // no vertex has it
  }
  return job.Check();
}

// Warns why there is nothing to voxelize, unless another warning already did.
void WarnOfNoTriangles(const Scene& scene, const std::vector<uint32_t>& order, TriangleMesh& mesh) {
  if (!mesh.triangles.empty()) return;
  for (const Warning& warning : mesh.warnings.kept()) {
    if (warning.code == WarningCode::kNoTriangles && warning.place.empty()) return;
  }
  bool any_mesh = false, any_other = false;
  std::vector<bool> seen(scene.meshes.size());
  for (const uint32_t n : order) {
    if (scene.nodes[n].mesh < 0) continue;
    any_mesh = true;
    const size_t m = size_t(scene.nodes[n].mesh);
    if (seen[m]) continue;
    seen[m] = true;
    for (const Primitive& primitive : scene.meshes[m].primitives) any_other = any_other || primitive.points_or_lines;
  }
  const char* const why = scene.roots.empty() ? "the scene is empty"
                          : !any_mesh         ? "no node of the scene has a mesh, or all of them are hidden"
                          : any_other         ? "the scene has only points or lines"
                                              : "the meshes of the scene have no triangles";
  mesh.warnings.Add(WarningCode::kNoTriangles, "", absl::StrCat("there is nothing to voxelize: ", why));
}

}  // namespace

uint64_t CountTriangles(const Scene& scene) {
  const std::vector<MeshCounts> counts = CountMeshes(scene);
  uint64_t triangles = 0;
  for (const uint32_t n : DepthFirst(scene)) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    const uint64_t copies = std::max<uint64_t>(1, node.instances.size());
    triangles = SaturatingAdd(triangles, SaturatingMul(copies, counts[size_t(node.mesh)].triangles));
  }
  return triangles;
}

absl::StatusOr<TriangleMesh> Flatten(const Scene& scene, const LoadLimits& limits) {
  const JobContext endless;
  return FlattenFor(endless, scene, limits);
}

absl::StatusOr<TriangleMesh> FlattenFor(const JobContext& job, const Scene& scene, const LoadLimits& limits) {
  MemoryCharge placing(&MemoryOf(job));
  if (absl::Status s = placing.Grow(TransformBytes(scene), "the scene's transforms"); !s.ok()) return s;
  const std::vector<uint32_t> order = DepthFirst(scene);
  if (absl::Status s = CheckLimits(scene, order, limits); !s.ok()) return s;
  const std::vector<Mat4d> world = WorldTransforms(scene);
  const std::vector<std::vector<Mat4d>> skins = SkinningMatrices(job, scene, world);
  if (absl::Status s = job.Check(); !s.ok()) return s;

  TriangleMesh mesh;
  mesh.memory = std::make_shared<MemoryCharge>(&MemoryOf(job));
  std::vector<Placement> placements;
  AttributeIds attributes;
  try {
    if (absl::Status s = Place(job, scene, order, world, skins, placing, placements, mesh); !s.ok()) return s;
    if (absl::Status s = AllocateArrays(job, mesh); !s.ok()) return s;
    if (absl::Status s = NameAttributes(job, placements, mesh, attributes); !s.ok()) return s;
    if (absl::Status s = AllocateAttributes(job, placements, attributes, mesh); !s.ok()) return s;
    if (absl::Status s = MakeRig(job, scene, placements, mesh); !s.ok()) return s;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while flattening the scene");
  }
  if (absl::Status s = SetNames(job, scene, order, mesh); !s.ok()) return s;
  mesh.warnings = scene.warnings;
  WarnOfNoTriangles(scene, order, mesh);
  mesh.materials = scene.materials;
  mesh.textures = scene.textures;
  mesh.images = scene.images;

  // The first bad vertex in id order, so that the message does not depend on the schedule.
  std::atomic<uint64_t> bad{UINT64_MAX};
  tbb::parallel_for(size_t{0}, placements.size(), [&](size_t i) {
    if (!job.Check().ok()) return;  // there may be ten million, and even a loop that does nothing takes time
    const Placement& p = placements[i];
    const MeshPart& part = mesh.parts[i];
    tbb::parallel_for(tbb::blocked_range<size_t>(0, part.triangle_count, kVertexGrain), [&](const auto& range) {
      if (job.Check().ok()) WriteTriangles(p, part, range.begin(), range.end(), mesh);
    });
    tbb::parallel_for(tbb::blocked_range<size_t>(0, part.vertex_count, kVertexGrain), [&](const auto& range) {
      if (!job.Check().ok()) return;
      WriteAttributes(p, part, attributes, range.begin(), range.end(), mesh);
      const size_t v = WriteVertices(p, part, range.begin(), range.end(), mesh);
      if (v == SIZE_MAX) return;
      const uint64_t id = part.first_vertex + v;
      uint64_t seen = bad.load();
      while (id < seen && !bad.compare_exchange_weak(seen, id)) {}
    });
  });
  if (absl::Status s = job.Check(); !s.ok()) return s;
  if (const uint64_t id = bad.load(); id != UINT64_MAX) {
    const auto part = std::partition_point(mesh.parts.begin(), mesh.parts.end(),
                                           [&](const MeshPart& p) { return p.first_vertex + p.vertex_count <= id; });
    return absl::InvalidArgumentError(
        absl::StrCat("node ", part->node, ", mesh ", part->mesh, ", primitive ", part->primitive, ", vertex ",
                     id - part->first_vertex, ": the transformed position is not finite, or a joint does not exist"));
  }
  absl::StatusOr<std::vector<uint32_t>> unused = UnusedVertices(job, mesh);
  if (absl::Status s = unused.ok() ? job.Check() : unused.status(); !s.ok()) return s;
  mesh.unused_vertices = *std::move(unused);
  mesh.memory->ShrinkTo(mesh.memory->bytes() - mesh.positions.size());  // the marks are gone
  return mesh;
}

}  // namespace voxelpipe
