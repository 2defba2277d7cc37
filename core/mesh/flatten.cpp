// Source: glTF 2.0 specification, sections 3.5.2 (transformations), 3.7.3 (skins), 3.7.4 (instantiation);
// EXT_mesh_gpu_instancing.
#include "mesh/flatten.h"
#include "mesh/flatten_job.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <new>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "mesh/pose.h"

namespace voxelpipe {
namespace {

constexpr size_t kVertexGrain = 1 << 13;

// One primitive of one node instance, and where it goes.
struct Placement {
  const Primitive* primitive = nullptr;
  const std::vector<Mat4d>* joints = nullptr;  // skinning matrices, or null
  Mat4d instance;                              // of EXT_mesh_gpu_instancing
  Mat4d world;                                 // node and instance transform, unless skinned
  bool mirrored = false;
  MeshPart part;
  std::vector<uint32_t> attributes;  // of the primitive's own attributes, their indices in TriangleMesh::attributes
};

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

std::vector<std::vector<Mat4d>> SkinningMatrices(const Scene& scene, const std::vector<Mat4d>& world) {
  std::vector<std::vector<Mat4d>> skins;
  for (const Skin& skin : scene.skins) {
    std::vector<Mat4d>& matrices = skins.emplace_back();
    for (size_t j = 0; j < skin.joints.size(); ++j) {
      matrices.push_back(Multiply(world[skin.joints[j]], skin.inverse_bind_matrices[j]));
    }
  }
  return skins;
}

bool IsSkinned(const Node& node, const Primitive& primitive, const std::vector<std::vector<Mat4d>>& skins) {
  return node.skin >= 0 && !primitive.joints[0].empty() && !primitive.weights[0].empty() && !skins[node.skin].empty();
}

absl::Status CheckLimits(const Scene& scene, const std::vector<uint32_t>& order, const LoadLimits& limits) {
  uint64_t triangles = 0, vertices = 0, instances = 0;
  for (const uint32_t n : order) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    const uint64_t copies = std::max<uint64_t>(1, node.instances.size());
    instances = SaturatingAdd(instances, copies);
    for (const Primitive& primitive : scene.meshes[node.mesh].primitives) {
      triangles = SaturatingAdd(triangles, SaturatingMul(copies, primitive.triangles.size()));
      vertices = SaturatingAdd(vertices, SaturatingMul(copies, primitive.positions.size()));
    }
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

std::vector<Placement> Place(const Scene& scene, const std::vector<uint32_t>& order, const std::vector<Mat4d>& world,
                             const std::vector<std::vector<Mat4d>>& skins) {
  std::vector<Placement> placements;
  uint64_t triangle = 0, vertex = 0;
  for (const uint32_t n : order) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    const std::vector<Primitive>& primitives = scene.meshes[node.mesh].primitives;
    for (size_t copy = 0; copy < std::max<size_t>(1, node.instances.size()); ++copy) {
      const Mat4d instance = node.instances.empty() ? world[n] : Multiply(world[n], node.instances[copy]);
      for (size_t i = 0; i < primitives.size(); ++i) {
        const Primitive& primitive = primitives[i];
        Placement p;
        p.primitive = &primitive;
        if (!node.instances.empty()) p.instance = node.instances[copy];
        if (IsSkinned(node, primitive, skins)) {  // the node's own transform is ignored
          p.joints = &skins[node.skin];
          p.mirrored = Determinant3(p.joints->front()) < 0;
        } else {
          p.world = instance;
          p.mirrored = Determinant3(instance) < 0;
        }
        p.part.first_triangle = triangle;
        p.part.triangle_count = primitive.triangles.size();
        p.part.first_vertex = vertex;
        p.part.vertex_count = primitive.positions.size();
        p.part.material = primitive.material;
        p.part.mesh = uint32_t(node.mesh);
        p.part.node = n;
        p.part.primitive = uint32_t(i);
        p.part.has_normals = !primitive.normals.empty();
        p.part.has_tangents = !primitive.tangents.empty();
        p.part.has_colors = !primitive.colors.empty();
        for (int s = 0; s < 2; ++s) p.part.has_uv[s] = !primitive.uv[s].empty();
        triangle += p.part.triangle_count;
        vertex += p.part.vertex_count;
        placements.push_back(std::move(p));
      }
    }
  }
  return placements;
}

bool Finite(const Vec3d& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

// Writes the vertices [begin, end) of one placement. Out: the first bad vertex, or SIZE_MAX.
size_t WriteVertices(const Placement& p, size_t begin, size_t end, TriangleMesh& mesh) {
  const Primitive& primitive = *p.primitive;
  std::vector<MorphTargetView> none;
  const RestPrimitiveView rest = RestView(primitive, none);  // for the joints; the arrays here are morphed already
  for (size_t v = begin; v < end; ++v) {
    Mat4d m = p.world;
    if (p.joints != nullptr && !BlendJoints(rest, p.joints->data(), uint32_t(p.joints->size()), v, m)) return v;
    const size_t at = p.part.first_vertex + v;
    const Vec3f& position = primitive.positions[v];
    mesh.positions[at] = TransformPoint(m, {position.x, position.y, position.z});
    if (!Finite(mesh.positions[at])) return v;
    if (p.part.has_normals) {
      const Vec3f& n = primitive.normals[v];
      mesh.normals[at] = UnitOrZero(TransformNormal(m, {n.x, n.y, n.z}));
    }
    if (p.part.has_tangents) {
      const Vec4f& t = primitive.tangents[v];
      const Vec3f unit = UnitOrZero(TransformVector(m, {t.x, t.y, t.z}));
      mesh.tangents[at] = {unit.x, unit.y, unit.z, p.mirrored ? -t.w : t.w};
    }
    for (int s = 0; s < 2; ++s) {
      if (p.part.has_uv[s]) mesh.uv[s][at] = primitive.uv[s][v];
    }
    if (p.part.has_colors) mesh.colors[at] = primitive.colors[v];
  }
  return SIZE_MAX;
}

// The file's own attributes of the vertices [begin, end) of one placement.
void WriteAttributes(const Placement& p, size_t begin, size_t end, TriangleMesh& mesh) {
  for (size_t i = 0; i < p.attributes.size(); ++i) {
    const VertexAttribute& from = p.primitive->attributes[i];
    VertexAttribute& to = mesh.attributes[p.attributes[i]];
    const size_t narrow = size_t(from.components), wide = size_t(to.components);
    float* const first = to.values.data() + p.part.first_vertex * wide;
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

void WriteTriangles(const Placement& p, size_t begin, size_t end, TriangleMesh& mesh) {
  const uint32_t base = uint32_t(p.part.first_vertex);
  for (size_t t = begin; t < end; ++t) {
    std::array<uint32_t, 3> v = p.primitive->triangles[t];
    if (p.mirrored) std::swap(v[1], v[2]);
    mesh.triangles[p.part.first_triangle + t] = {base + v[0], base + v[1], base + v[2]};
  }
}

// The rig of the placed parts, null where nothing in the scene can take another pose. Copies each primitive once.
std::shared_ptr<const Rig> MakeRig(const Scene& scene, const std::vector<Placement>& placements) {
  const bool morphs = std::any_of(placements.begin(), placements.end(),
                                  [](const Placement& p) { return p.primitive->morph != nullptr; });
  if (scene.animations.empty() && !morphs) return nullptr;
  auto rig = std::make_shared<Rig>();
  rig->skins = scene.skins;
  rig->animations = scene.animations;
  rig->nodes.resize(scene.nodes.size());
  std::vector<uint32_t> stack;
  for (size_t n = 0; n < scene.nodes.size(); ++n) {
    const Node& node = scene.nodes[n];
    rig->nodes[n].local = node.local;
    rig->nodes[n].trs = node.trs;
    if (node.mesh >= 0) rig->nodes[n].weights = scene.meshes[size_t(node.mesh)].weights;
    for (const uint32_t child : node.children) rig->nodes[child].parent = int64_t(n);
  }
  for (size_t n = 0; n < scene.nodes.size(); ++n) {
    if (rig->nodes[n].parent < 0) stack.push_back(uint32_t(n));
  }
  while (!stack.empty()) {
    const uint32_t n = stack.back();
    stack.pop_back();
    rig->order.push_back(n);
    stack.insert(stack.end(), scene.nodes[n].children.begin(), scene.nodes[n].children.end());
  }
  std::map<const Primitive*, std::shared_ptr<const Primitive>> copies;
  for (const Placement& p : placements) {
    std::shared_ptr<const Primitive>& copy = copies[p.primitive];
    if (copy == nullptr) {
      auto fresh = std::make_shared<Primitive>();
      if (p.primitive->morph == nullptr) {  // the morph data holds the unposed attributes
        fresh->positions = p.primitive->positions;
        fresh->normals = p.primitive->normals;
        fresh->tangents = p.primitive->tangents;
      }
      for (int set = 0; set < 2; ++set) {
        fresh->joints[set] = p.primitive->joints[set];
        fresh->weights[set] = p.primitive->weights[set];
      }
      fresh->morph = p.primitive->morph;
      copy = std::move(fresh);
    }
    rig->parts.push_back({copy, p.part.node, p.joints != nullptr ? scene.nodes[p.part.node].skin : -1, p.instance});
  }
  return rig;
}

// Names the attributes of all placements in the mesh, and tells each placement which of them are its own.
absl::Status NameAttributes(std::vector<Placement>& placements, const LoadLimits& limits, TriangleMesh& mesh) {
  std::map<std::string, uint32_t> ids;
  uint64_t vertices = 0, components = 0;
  for (Placement& p : placements) {
    vertices += p.part.vertex_count;
    for (const VertexAttribute& attribute : p.primitive->attributes) {
      const auto [id, fresh] = ids.try_emplace(attribute.name, uint32_t(mesh.attributes.size()));
      if (fresh) mesh.attributes.push_back({attribute.name, attribute.components, {}});
      int& widest = mesh.attributes[id->second].components;
      widest = std::max(widest, attribute.components);
      p.attributes.push_back(id->second);
    }
  }
  for (const VertexAttribute& attribute : mesh.attributes) components += uint64_t(attribute.components);
  const uint64_t bytes = SaturatingMul(SaturatingMul(vertices, components), sizeof(float));
  if (bytes > limits.max_decoded_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat("the file's own vertex attributes take ", bytes,
                                                     " bytes after instancing; the limit max_decoded_bytes is ",
                                                     limits.max_decoded_bytes));
  }
  for (VertexAttribute& attribute : mesh.attributes) attribute.values.resize(vertices * uint64_t(attribute.components));
  return absl::OkStatus();
}

// The same as resize, but that it may end with the job: writing fresh pages takes its time.
template <typename T>
void Resize(const JobContext& job, std::vector<T>& values, size_t count, const T& value = T()) {
  constexpr size_t kStepBytes = 1 << 20;
  values.reserve(count);
  while (values.size() < count && job.Check().ok()) {
    values.resize(std::min(count, values.size() + kStepBytes / sizeof(T)), value);
  }
}

// What a job that ends leaves short must not be used.
void AllocateArrays(const JobContext& job, const std::vector<Placement>& placements, TriangleMesh& mesh) {
  uint64_t vertices = 0, triangles = 0;
  bool normals = false, tangents = false, colors = false, uv[2] = {false, false};
  for (const Placement& p : placements) {
    vertices += p.part.vertex_count;
    triangles += p.part.triangle_count;
    normals = normals || p.part.has_normals;
    tangents = tangents || p.part.has_tangents;
    colors = colors || p.part.has_colors;
    for (int s = 0; s < 2; ++s) uv[s] = uv[s] || p.part.has_uv[s];
    mesh.parts.push_back(p.part);
  }
  Resize(job, mesh.positions, vertices);
  Resize(job, mesh.triangles, triangles);
  if (normals) Resize(job, mesh.normals, vertices);
  if (tangents) Resize(job, mesh.tangents, vertices);
  if (colors) Resize(job, mesh.colors, vertices, Vec4f{1, 1, 1, 1});
  for (int s = 0; s < 2; ++s) {
    if (uv[s]) Resize(job, mesh.uv[s], vertices);
  }
}

std::vector<uint32_t> UnusedVertices(const JobContext& job, const TriangleMesh& mesh) {
  std::vector<uint8_t> used(mesh.positions.size());
  tbb::parallel_for(tbb::blocked_range<size_t>(0, mesh.triangles.size(), kVertexGrain), [&](const auto& range) {
    if (!job.Check().ok()) return;
    for (size_t t = range.begin(); t < range.end(); ++t) {
      for (const uint32_t v : mesh.triangles[t]) std::atomic_ref<uint8_t>(used[v]).store(1, std::memory_order_relaxed);
    }
  });
  std::vector<uint32_t> unused;
  for (auto v = std::find(used.begin(), used.end(), 0); v != used.end(); v = std::find(v + 1, used.end(), 0)) {
    unused.push_back(uint32_t(v - used.begin()));
  }
  return unused;
}

// Says why there is nothing to voxelize, where nothing said so before.
void WarnOfNoTriangles(const Scene& scene, const std::vector<uint32_t>& order, TriangleMesh& mesh) {
  if (!mesh.triangles.empty()) return;
  for (const Warning& warning : mesh.warnings.kept()) {
    if (warning.code == WarningCode::kNoTriangles && warning.place.empty()) return;
  }
  bool any_mesh = false, any_other = false;
  for (const uint32_t n : order) {
    if (scene.nodes[n].mesh < 0) continue;
    any_mesh = true;
    for (const Primitive& primitive : scene.meshes[size_t(scene.nodes[n].mesh)].primitives) {
      any_other = any_other || primitive.points_or_lines;
    }
  }
  const char* const why = scene.roots.empty() ? "the scene is empty"
                          : !any_mesh         ? "no node of the scene has a mesh, or all of them are hidden"
                          : any_other         ? "the scene has only points or lines"
                                              : "the meshes of the scene have no triangles";
  mesh.warnings.Add(WarningCode::kNoTriangles, "", absl::StrCat("there is nothing to voxelize: ", why));
}

}  // namespace

uint64_t CountTriangles(const Scene& scene) {
  uint64_t triangles = 0;
  for (const uint32_t n : DepthFirst(scene)) {
    const Node& node = scene.nodes[n];
    if (node.mesh < 0) continue;
    for (const Primitive& primitive : scene.meshes[node.mesh].primitives) {
      const uint64_t copies = std::max<uint64_t>(1, node.instances.size());
      triangles = SaturatingAdd(triangles, SaturatingMul(copies, primitive.triangles.size()));
    }
  }
  return triangles;
}

absl::StatusOr<TriangleMesh> Flatten(const Scene& scene, const LoadLimits& limits) {
  const JobContext endless;
  return FlattenFor(endless, scene, limits);
}

absl::StatusOr<TriangleMesh> FlattenFor(const JobContext& job, const Scene& scene, const LoadLimits& limits) {
  const std::vector<uint32_t> order = DepthFirst(scene);
  if (absl::Status s = CheckLimits(scene, order, limits); !s.ok()) return s;
  const std::vector<Mat4d> world = WorldTransforms(scene);
  const std::vector<std::vector<Mat4d>> skins = SkinningMatrices(scene, world);
  std::vector<Placement> placements = Place(scene, order, world, skins);

  TriangleMesh mesh;
  try {
    AllocateArrays(job, placements, mesh);
    if (absl::Status s = job.Check(); !s.ok()) return s;
    if (absl::Status s = NameAttributes(placements, limits, mesh); !s.ok()) return s;
    mesh.rig = MakeRig(scene, placements);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while flattening the scene");
  }
  mesh.warnings = scene.warnings;
  WarnOfNoTriangles(scene, order, mesh);
  mesh.materials = scene.materials;
  mesh.textures = scene.textures;
  mesh.images = scene.images;

  // The first bad vertex in id order, so that the message does not depend on the schedule.
  std::atomic<uint64_t> bad{UINT64_MAX};
  tbb::parallel_for(size_t{0}, placements.size(), [&](size_t i) {
    const Placement& p = placements[i];
    tbb::parallel_for(tbb::blocked_range<size_t>(0, p.part.triangle_count, kVertexGrain), [&](const auto& range) {
      if (job.Check().ok()) WriteTriangles(p, range.begin(), range.end(), mesh);
    });
    tbb::parallel_for(tbb::blocked_range<size_t>(0, p.part.vertex_count, kVertexGrain), [&](const auto& range) {
      if (!job.Check().ok()) return;
      WriteAttributes(p, range.begin(), range.end(), mesh);
      const size_t v = WriteVertices(p, range.begin(), range.end(), mesh);
      if (v == SIZE_MAX) return;
      const uint64_t id = p.part.first_vertex + v;
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
  mesh.unused_vertices = UnusedVertices(job, mesh);
  if (absl::Status s = job.Check(); !s.ok()) return s;
  return mesh;
}

}  // namespace voxelpipe
