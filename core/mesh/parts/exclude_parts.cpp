#include <algorithm>
#include <memory>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/long_loops.h"
#include "mesh/mesh_bytes.h"
#include "mesh/parts/part_list.h"

namespace voxelpipe {
namespace {

// Copies the elements of the kept runs, `of_vertices` or of triangles.
template <typename T>
absl::Status CopyKept(const JobContext& job, const std::vector<T>& from, const std::vector<MeshPart>& runs,
                      const std::vector<bool>& out, bool of_vertices, std::vector<T>& to) {
  if (from.empty()) return absl::OkStatus();
  uint64_t kept = 0;
  for (size_t run = 0; run < runs.size(); ++run) {
    if (!out[run]) kept += of_vertices ? runs[run].vertex_count : runs[run].triangle_count;
  }
  to.reserve(kept);
  for (size_t run = 0; run < runs.size(); ++run) {
    if (out[run]) continue;
    const uint64_t first = of_vertices ? runs[run].first_vertex : runs[run].first_triangle;
    const uint64_t count = of_vertices ? runs[run].vertex_count : runs[run].triangle_count;
    absl::Status over = InSteps(job, count, [&](uint64_t begin, uint64_t end) {
      to.insert(to.end(), from.begin() + ptrdiff_t(first + begin), from.begin() + ptrdiff_t(first + end));
    });
    if (!over.ok()) return over;
  }
  return absl::OkStatus();
}

// The values of the kept runs. Each run has the attribute in all its vertices or in none.
absl::Status CopyAttribute(const JobContext& job, const VertexAttribute& from, const std::vector<MeshPart>& runs,
                           const std::vector<bool>& out, VertexAttribute& to) {
  const auto wide = uint64_t(from.components);
  uint64_t vertex = 0;
  size_t at = 0;
  to.values.reserve(from.values.size());
  for (size_t run = 0; run < runs.size(); ++run) {
    const MeshPart& part = runs[run];
    while (at < from.runs.size() && from.runs[at].end_vertex <= part.first_vertex) ++at;
    if (out[run]) continue;
    const bool all = from.runs.empty();
    const bool has =
        part.vertex_count > 0 && (all || (at < from.runs.size() && from.runs[at].first_vertex <= part.first_vertex));
    if (has) {
      const uint64_t first = all ? part.first_vertex * wide
                                 : from.runs[at].first_value + (part.first_vertex - from.runs[at].first_vertex) * wide;
      if (!to.runs.empty() && to.runs.back().end_vertex == vertex) {
        to.runs.back().end_vertex += part.vertex_count;
      } else {
        to.runs.push_back({vertex, vertex + part.vertex_count, to.values.size()});
      }
      absl::Status over = InSteps(job, part.vertex_count * wide, [&](uint64_t begin, uint64_t end) {
        const auto values = from.values.begin() + ptrdiff_t(first);
        to.values.insert(to.values.end(), values + ptrdiff_t(begin), values + ptrdiff_t(end));
      });
      if (!over.ok()) return over;
    }
    vertex += part.vertex_count;
  }
  const bool whole = to.runs.size() == 1 && to.runs[0].first_vertex == 0 && to.runs[0].end_vertex == vertex;
  if (to.runs.empty()) to.runs = {AttributeRun{0, 0, 0}};  // no vertex has it
  if (whole) to.runs.clear();
  return absl::OkStatus();
}

std::shared_ptr<const Rig> RigOf(const Rig& from, const std::vector<bool>& out) {
  auto rig = std::make_shared<Rig>(from);
  rig->parts.clear();
  for (size_t run = 0; run < from.parts.size(); ++run) {
    if (!out[run]) rig->parts.push_back(from.parts[run]);
  }
  return rig;
}

// Fills the lists of the mesh that name its runs.
absl::Status CopyRuns(const JobContext& job, const TriangleMesh& mesh, const std::vector<bool>& out,
                      TriangleMesh& kept) {
  uint64_t vertex = 0, triangle = 0;
  size_t entry = 0;
  kept.placed = mesh.placed;
  for (PlacedEntry& placed : kept.placed) placed.open_edges.reset();
  for (size_t run = 0; run <= mesh.parts.size(); ++run) {
    while (entry < kept.placed.size() && mesh.placed[entry].first_part <= run) {
      kept.placed[entry++].first_part = kept.parts.size();
    }
    if (run == mesh.parts.size() || out[run]) continue;
    const MeshPart& from = mesh.parts[run];
    MeshPart part = from;
    part.first_vertex = vertex;
    part.first_triangle = triangle;
    absl::Status over = InSteps(job, part.triangle_count, [&](uint64_t begin, uint64_t end) {
      for (uint64_t t = begin; t < end; ++t) {
        for (uint32_t& corner : kept.triangles[triangle + t]) corner += uint32_t(vertex) - uint32_t(from.first_vertex);
      }
    });
    if (!over.ok()) return over;
    vertex += part.vertex_count;
    triangle += part.triangle_count;
    kept.parts.push_back(part);
  }
  return absl::OkStatus();
}

// Unused vertices, by runs: both lists ascend.
void CopyUnused(const TriangleMesh& mesh, const std::vector<bool>& out, TriangleMesh& kept) {
  if (!mesh.unused_vertices) return;
  std::vector<uint32_t>& unused = kept.unused_vertices.emplace();
  size_t at = 0, to = 0;
  for (size_t run = 0; run < mesh.parts.size(); ++run) {
    const MeshPart& part = mesh.parts[run];
    const uint64_t end = part.first_vertex + part.vertex_count;
    for (; at < mesh.unused_vertices->size() && (*mesh.unused_vertices)[at] < end; ++at) {
      if (out[run]) continue;
      unused.push_back((*mesh.unused_vertices)[at] - uint32_t(part.first_vertex) +
                       uint32_t(kept.parts[to].first_vertex));
    }
    if (!out[run]) ++to;
  }
}

}  // namespace

absl::StatusOr<TriangleMesh> ExcludeParts(const JobContext& job, const TriangleMesh& mesh,
                                          const PartSelection& selection) {
  TriangleMesh kept;
  kept.warnings = mesh.warnings;
  const absl::StatusOr<std::vector<bool>> excluded = ExcludedRuns(job, mesh, selection, kept.warnings);
  if (!excluded.ok()) return excluded.status();
  const std::vector<bool>& out = *excluded;
  kept.memory = std::make_shared<MemoryCharge>(&MemoryOf(job));
  const uint64_t lists = 2 * mesh.parts.size() * sizeof(MeshPart) + mesh.placed.size() * sizeof(PlacedEntry) +
                         (mesh.unused_vertices ? 2 * mesh.unused_vertices->size() * sizeof(uint32_t) : 0);
  if (absl::Status full = kept.memory->Grow(MeshBytes(mesh) + lists, "the mesh without the excluded parts");
      !full.ok()) {
    return full;
  }
  try {
    const std::vector<MeshPart>& runs = mesh.parts;
    absl::Status s = CopyKept(job, mesh.positions, runs, out, true, kept.positions);
    if (s.ok()) s = CopyKept(job, mesh.normals, runs, out, true, kept.normals);
    if (s.ok()) s = CopyKept(job, mesh.tangents, runs, out, true, kept.tangents);
    for (int set = 0; set < 2 && s.ok(); ++set) s = CopyKept(job, mesh.uv[set], runs, out, true, kept.uv[set]);
    if (s.ok()) s = CopyKept(job, mesh.colors, runs, out, true, kept.colors);
    if (s.ok()) s = CopyKept(job, mesh.triangles, runs, out, false, kept.triangles);
    for (size_t i = 0; i < mesh.attributes.size() && s.ok(); ++i) {
      kept.attributes.push_back({mesh.attributes[i].name, mesh.attributes[i].components, {}});
      s = CopyAttribute(job, mesh.attributes[i], runs, out, kept.attributes.back());
    }
    if (s.ok()) s = CopyRuns(job, mesh, out, kept);
    if (!s.ok()) return s;
    CopyUnused(mesh, out, kept);
    if (mesh.rig != nullptr) kept.rig = RigOf(*mesh.rig, out);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while leaving parts out");
  }
  kept.materials = mesh.materials;
  kept.textures = mesh.textures;
  kept.images = mesh.images;
  kept.names = mesh.names;
  kept.mesh_count = mesh.mesh_count;
  kept.node_count = mesh.node_count;
  kept.parts_left_out = true;
  if (kept.triangles.empty() && !mesh.triangles.empty()) {
    kept.warnings.Add(WarningCode::kNoTriangles, "", "there is nothing to voxelize: every part is excluded");
  }
  return kept;
}

}  // namespace voxelpipe
