#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/long_loops.h"
#include "mesh/place/join.h"
#include "mesh/placed_mesh.h"
#include "mesh/scene/vertex_pose.h"

namespace voxelpipe {
namespace {

constexpr size_t kGrain = 1 << 14;  // vertices or triangles of one task
constexpr char kWhat[] = "the placed meshes";
constexpr double kSingular = 1e-12;  // of the product of the columns' lengths

absl::Status CheckList(std::span<const PlacedMesh> meshes) {
  if (meshes.empty()) return absl::InvalidArgumentError("no mesh to place");
  if (meshes.size() > kMaxPlacedMeshes) {
    return absl::InvalidArgumentError(
        absl::StrCat(meshes.size(), " meshes on one grid; at most ", kMaxPlacedMeshes, " may be placed"));
  }
  for (size_t i = 0; i < meshes.size(); ++i) {
    absl::Status wrong = CheckPlacement(meshes[i].matrix);
    if (wrong.ok() && meshes[i].label == 0u) wrong = absl::InvalidArgumentError("label: must be at least 1");
    if (wrong.ok()) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("meshes[", i, "]", meshes[i].name.empty() ? "" : absl::StrCat(" (", meshes[i].name, ")"), ": ",
                     std::string(wrong.message())));
  }
  return absl::OkStatus();
}

// What each entry adds to the lists of the whole.
struct Offsets {
  uint64_t vertex = 0, triangle = 0, part = 0;
  uint32_t mesh = 0, node = 0, material = 0, texture = 0;
};

uint32_t CountOf(uint32_t said, const TriangleMesh& mesh, uint32_t MeshPart::*id) {
  for (const MeshPart& part : mesh.parts) said = std::max(said, part.*id + 1);
  return said;
}

// Textures and images of a mesh that is placed often are listed once: materials of all its copies share them.
void ListTextures(const TriangleMesh& from, TriangleMesh& to) {
  const auto image = int32_t(to.images.size());
  for (Texture texture : from.textures) {
    if (texture.image >= 0) texture.image += image;
    to.textures.push_back(texture);
  }
  to.images.insert(to.images.end(), from.images.begin(), from.images.end());
}

Material Renumbered(Material material, uint32_t texture) {
  for (TextureRef* ref : {&material.base_color, &material.emissive, &material.metallic_roughness}) {
    if (ref->texture >= 0) ref->texture += int32_t(texture);
  }
  return material;
}

// Lists parts, materials, textures and entries, and says where each mesh begins. Charged to mesh.memory.
absl::Status ListParts(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh,
                       std::vector<Offsets>& offsets) {
  Offsets at;
  std::unordered_map<const TriangleMesh*, uint32_t> textures;
  for (size_t i = 0; i < meshes.size(); ++i) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const PlacedMesh& placed = meshes[i];
    const TriangleMesh& from = *placed.mesh;
    const auto [known, fresh] = textures.try_emplace(&from, uint32_t(mesh.textures.size()));
    uint64_t bytes = 2 * sizeof(PlacedEntry) + placed.name.size() + from.parts.size() * sizeof(MeshPart) +
                     from.materials.size() * sizeof(Material);
    for (const Material& material : from.materials) bytes += material.name.size();
    if (fresh) bytes += from.textures.size() * sizeof(Texture) + from.images.size() * sizeof(from.images[0]);
    if (absl::Status full = mesh.memory->Grow(bytes, kWhat); !full.ok()) return full;
    if (fresh) ListTextures(from, mesh);
    at.texture = known->second;
    offsets.push_back(at);
    mesh.placed.push_back({at.part, placed.name, placed.label.value_or(uint32_t(i + 1)), placed.priority, placed.motion,
                           from.names, at.node, at.mesh, placed.open_edges});
    for (MeshPart part : from.parts) {
      part.first_triangle += at.triangle;
      part.first_vertex += at.vertex;
      part.mesh += at.mesh;
      part.node += at.node;
      if (part.material >= 0) part.material += int32_t(at.material);
      mesh.parts.push_back(part);
    }
    for (const Material& material : from.materials) mesh.materials.push_back(Renumbered(material, at.texture));
    at.vertex += from.positions.size();
    at.triangle += from.triangles.size();
    at.part += from.parts.size();
    at.mesh += CountOf(from.mesh_count, from, &MeshPart::mesh);
    at.node += CountOf(from.node_count, from, &MeshPart::node);
    at.material += uint32_t(from.materials.size());
    for (const Warning& warning : from.warnings.kept()) {
      mesh.warnings.Add(warning.code, absl::StrCat(placed.name, warning.place.empty() ? "" : ", ", warning.place),
                        warning.text);
    }
  }
  mesh.mesh_count = at.mesh;
  mesh.node_count = at.node;
  return absl::OkStatus();
}

absl::Status CheckLimits(std::span<const PlacedMesh> meshes, const LoadLimits& limits) {
  uint64_t triangles = 0, vertices = 0;
  for (const PlacedMesh& placed : meshes) {
    triangles += placed.mesh->triangles.size();
    vertices += placed.mesh->positions.size();
  }
  const auto exhausted = [](const char* what, uint64_t need, uint64_t limit) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the placed meshes have ", need, " ", what, ", the limit is ", limit));
  };
  if (triangles > limits.max_triangles) return exhausted("triangles", triangles, limits.max_triangles);
  const uint64_t max_vertices = std::min<uint64_t>(limits.max_vertices, UINT32_MAX);  // indices are 32-bit
  if (vertices > max_vertices) return exhausted("vertices", vertices, max_vertices);
  return absl::OkStatus();
}

// Sizes the arrays of vertices and triangles, charged to mesh.memory.
absl::Status AllocateArrays(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh) {
  uint64_t vertices = 0, triangles = 0, unused = 0;
  bool normals = false, tangents = false, colors = false, uv[2] = {false, false}, unused_known = true;
  for (const PlacedMesh& placed : meshes) {
    const TriangleMesh& from = *placed.mesh;
    vertices += from.positions.size();
    triangles += from.triangles.size();
    normals = normals || !from.normals.empty();
    tangents = tangents || !from.tangents.empty();
    colors = colors || !from.colors.empty();
    for (int s = 0; s < 2; ++s) uv[s] = uv[s] || !from.uv[s].empty();
    unused_known = unused_known && from.unused_vertices.has_value();
    if (from.unused_vertices) unused += from.unused_vertices->size();
  }
  uint64_t vertex_bytes = sizeof(Vec3d);
  if (normals) vertex_bytes += sizeof(Vec3f);
  if (tangents) vertex_bytes += sizeof(Vec4f);
  if (colors) vertex_bytes += sizeof(Vec4f);
  for (int s = 0; s < 2; ++s) vertex_bytes += uv[s] ? sizeof(Vec2f) : 0;
  absl::Status s = mesh.memory->Grow(vertices, vertex_bytes, kWhat);
  if (s.ok()) s = mesh.memory->Grow(triangles, sizeof(mesh.triangles[0]), kWhat);
  if (s.ok() && unused_known) s = mesh.memory->Grow(unused, sizeof(uint32_t), kWhat);
  if (s.ok()) s = Resize(job, mesh.positions, vertices);
  if (s.ok()) s = Resize(job, mesh.triangles, triangles);
  if (s.ok() && normals) s = Resize(job, mesh.normals, vertices);
  if (s.ok() && tangents) s = Resize(job, mesh.tangents, vertices);
  if (s.ok() && colors) s = Resize(job, mesh.colors, vertices, Vec4f{1, 1, 1, 1});
  for (int set = 0; set < 2; ++set) {
    if (s.ok() && uv[set]) s = Resize(job, mesh.uv[set], vertices);
  }
  if (unused_known) mesh.unused_vertices.emplace().reserve(unused);
  return s;
}

// Writes the vertices [begin, end) of one mesh.
void WriteVertices(const PlacedMesh& placed, bool as_it_is, bool mirrored, size_t begin, size_t end, uint64_t first,
                   TriangleMesh& mesh) {
  const TriangleMesh& from = *placed.mesh;
  const Mat4d m = MatrixOf(placed);
  for (size_t v = begin; v < end; ++v) {
    const size_t at = first + v;
    mesh.positions[at] = as_it_is ? from.positions[v] : TransformPoint(m, from.positions[v]);
    if (!from.normals.empty()) {
      const Vec3f& n = from.normals[v];
      mesh.normals[at] = as_it_is ? n : UnitOrZero(TransformNormal(m, {n.x, n.y, n.z}));
    }
    if (!from.tangents.empty()) {
      const Vec4f& t = from.tangents[v];
      const Vec3f unit = UnitOrZero(TransformVector(m, {t.x, t.y, t.z}));
      mesh.tangents[at] = as_it_is ? t : Vec4f{unit.x, unit.y, unit.z, mirrored ? -t.w : t.w};
    }
    for (int s = 0; s < 2; ++s) {
      if (!from.uv[s].empty()) mesh.uv[s][at] = from.uv[s][v];
    }
    if (!from.colors.empty()) mesh.colors[at] = from.colors[v];
  }
}

void WriteTriangles(const TriangleMesh& from, bool mirrored, size_t begin, size_t end, const Offsets& at,
                    TriangleMesh& mesh) {
  const auto base = uint32_t(at.vertex);
  for (size_t t = begin; t < end; ++t) {
    std::array<uint32_t, 3> v = from.triangles[t];
    if (mirrored) std::swap(v[1], v[2]);
    mesh.triangles[at.triangle + t] = {base + v[0], base + v[1], base + v[2]};
  }
}

void WriteArrays(const JobContext& job, std::span<const PlacedMesh> meshes, const std::vector<Offsets>& offsets,
                 TriangleMesh& mesh) {
  tbb::parallel_for(size_t{0}, meshes.size(), [&](size_t i) {
    const PlacedMesh& placed = meshes[i];
    const TriangleMesh& from = *placed.mesh;
    const bool as_it_is = placed.matrix == Mat4d(), mirrored = Determinant3(placed.matrix) < 0;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, from.triangles.size(), kGrain), [&](const auto& range) {
      if (job.Check().ok()) WriteTriangles(from, mirrored, range.begin(), range.end(), offsets[i], mesh);
    });
    tbb::parallel_for(tbb::blocked_range<size_t>(0, from.positions.size(), kGrain), [&](const auto& range) {
      if (!job.Check().ok()) return;
      WriteVertices(placed, as_it_is, mirrored, range.begin(), range.end(), offsets[i].vertex, mesh);
    });
  });
}

absl::Status ListUnused(const JobContext& job, std::span<const PlacedMesh> meshes, const std::vector<Offsets>& offsets,
                        TriangleMesh& mesh) {
  if (!mesh.unused_vertices) return absl::OkStatus();
  for (size_t i = 0; i < meshes.size(); ++i) {
    const std::vector<uint32_t>& unused = *meshes[i].mesh->unused_vertices;
    absl::Status over = InSteps(job, unused.size(), [&](uint64_t begin, uint64_t end) {
      for (uint64_t n = begin; n < end; ++n) {
        mesh.unused_vertices->push_back(uint32_t(offsets[i].vertex) + unused[n]);
      }
    });
    if (!over.ok()) return over;
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckPlacement(const Mat4d& matrix) {
  double columns = 1;
  for (int c = 0; c < 4; ++c) {
    double length = 0;
    for (int r = 0; r < 4; ++r) {
      const double number = matrix.m[r][c];
      if (!std::isfinite(number)) {
        return absl::InvalidArgumentError(absl::StrCat("matrix[", r * 4 + c, "]: must be a finite number"));
      }
      if (r < 3) length = std::hypot(length, number);
      if (r == 3 && number != (c == 3 ? 1 : 0)) {
        return absl::InvalidArgumentError("matrix: its last row must be 0 0 0 1 (16 numbers, row by row)");
      }
    }
    if (c < 3) columns *= length;
  }
  const double determinant = Determinant3(matrix);
  if (!std::isfinite(determinant) || !(std::abs(determinant) > kSingular * columns)) {
    return absl::InvalidArgumentError("matrix: is singular: it would make the mesh flat");
  }
  return absl::OkStatus();
}

absl::StatusOr<TriangleMesh> PlaceMeshes(const JobContext& job, std::span<const PlacedMesh> meshes,
                                         const LoadLimits& limits) {
  absl::Status s = CheckList(meshes);
  if (s.ok()) s = CheckLimits(meshes, limits);
  if (!s.ok()) return s;
  TriangleMesh mesh;
  mesh.memory = std::make_shared<MemoryCharge>(&MemoryOf(job));
  try {
    std::vector<Offsets> offsets;
    s = ListParts(job, meshes, mesh, offsets);
    if (s.ok()) s = AllocateArrays(job, meshes, mesh);
    if (s.ok()) s = JoinAttributes(job, meshes, mesh);
    if (s.ok()) s = JoinRigs(job, meshes, mesh);
    if (s.ok()) s = ListUnused(job, meshes, offsets, mesh);
    if (!s.ok()) return s;
    WriteArrays(job, meshes, offsets, mesh);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while placing the meshes");
  }
  s = job.Check();
  if (!s.ok()) return s;
  return mesh;
}

}  // namespace voxelpipe
