#include <algorithm>
#include <string>
#include <unordered_map>

#include "base/long_loops.h"
#include "mesh/place/join.h"

namespace voxelpipe {
namespace {

constexpr char kWhat[] = "the vertex attributes of the placed meshes";

// The runs of an attribute, one for all vertices where it lists none.
std::vector<AttributeRun> RunsOf(const VertexAttribute& attribute, uint64_t vertices) {
  if (!attribute.runs.empty()) return attribute.runs;
  return {AttributeRun{0, vertices, 0}};
}

// Copies the values of `count` vertices; missing components are 0, the fourth 1.
absl::Status Append(const JobContext& job, const VertexAttribute& from, uint64_t first_value, uint64_t count,
                    VertexAttribute& to) {
  const auto narrow = size_t(from.components), wide = size_t(to.components);
  return InSteps(job, count, [&](uint64_t begin, uint64_t end) {
    for (uint64_t v = begin; v < end; ++v) {
      const float* const values = from.values.data() + first_value + v * narrow;
      to.values.insert(to.values.end(), values, values + narrow);
      for (size_t c = narrow; c < wide; ++c) to.values.push_back(c == 3 ? 1.0f : 0.0f);
    }
  });
}

}  // namespace

absl::Status JoinAttributes(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh) {
  std::unordered_map<std::string, size_t> ids;
  for (const PlacedMesh& placed : meshes) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    for (const VertexAttribute& attribute : placed.mesh->attributes) {
      const auto [id, fresh] = ids.try_emplace(attribute.name, mesh.attributes.size());
      if (fresh) mesh.attributes.push_back({attribute.name, attribute.components, {}});
      int& widest = mesh.attributes[id->second].components;
      widest = std::max(widest, attribute.components);
    }
  }
  if (ids.empty()) return absl::OkStatus();
  std::vector<uint64_t> values(mesh.attributes.size());
  uint64_t runs = 0;
  for (const PlacedMesh& placed : meshes) {
    for (const VertexAttribute& attribute : placed.mesh->attributes) {
      const size_t id = ids.at(attribute.name);
      values[id] += attribute.values.size() / size_t(attribute.components) * size_t(mesh.attributes[id].components);
      runs += std::max<size_t>(1, attribute.runs.size());
    }
  }
  for (size_t id = 0; id < values.size(); ++id) {
    if (absl::Status full = mesh.memory->Grow(values[id], sizeof(float), kWhat); !full.ok()) return full;
    mesh.attributes[id].values.reserve(values[id]);
  }
  // Twice: the lists grow by doubling.
  if (absl::Status full = mesh.memory->Grow(runs, 2 * sizeof(AttributeRun), kWhat); !full.ok()) return full;
  uint64_t first_vertex = 0;
  for (const PlacedMesh& placed : meshes) {
    const uint64_t vertices = placed.mesh->positions.size();
    for (const VertexAttribute& from : placed.mesh->attributes) {
      VertexAttribute& to = mesh.attributes[ids.at(from.name)];
      for (const AttributeRun& run : RunsOf(from, vertices)) {
        if (run.first_vertex == run.end_vertex) continue;
        const uint64_t begin = first_vertex + run.first_vertex, end = first_vertex + run.end_vertex;
        if (!to.runs.empty() && to.runs.back().end_vertex == begin) {
          to.runs.back().end_vertex = end;
        } else {
          to.runs.push_back({begin, end, to.values.size()});
        }
        absl::Status over = Append(job, from, run.first_value, run.end_vertex - run.first_vertex, to);
        if (!over.ok()) return over;
      }
    }
    first_vertex += vertices;
  }
  for (VertexAttribute& attribute : mesh.attributes) {
    const bool one = attribute.runs.size() == 1;
    if (attribute.runs.empty()) attribute.runs = {AttributeRun{0, 0, 0}};  // no vertex has it
    if (one && attribute.runs[0].first_vertex == 0 && attribute.runs[0].end_vertex == first_vertex) {
      attribute.runs.clear();  // all vertices have it
    }
  }
  return job.Check();
}

}  // namespace voxelpipe
