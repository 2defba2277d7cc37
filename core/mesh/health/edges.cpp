// Source: B. A. Galler, M. J. Fischer, "An improved equivalence algorithm", 1964 (the forest of shells), with the
// smaller id as the root, so that the result does not depend on the order of the edges.
#include "mesh/health/edges.h"

#include <algorithm>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/long_loops.h"
#include "base/parallel.h"

namespace voxelpipe {
namespace {

struct Edge {
  uint32_t low, high;  // ids of the ends; equal: no edge
  uint32_t triangle;
  uint32_t rises;  // 1 if the triangle runs from low to high

  bool operator<(const Edge& b) const {
    return std::tie(low, high, triangle, rises) < std::tie(b.low, b.high, b.triangle, b.rises);
  }
  bool Joins(const Edge& b) const { return low == b.low && high == b.high; }
};

absl::StatusOr<std::vector<Edge>> ListEdges(const JobContext& job, const TriangleMesh& mesh,
                                            const WeldedVertices& welded, const std::vector<uint8_t>& left_out) {
  std::vector<Edge> edges;
  if (absl::Status over = Resize(job, edges, mesh.triangles.size() * 3); !over.ok()) return over;
  const auto list = [&](size_t t) {
    const auto& corners = mesh.triangles[t];
    const uint32_t id[3] = {welded.id[corners[0]], welded.id[corners[1]], welded.id[corners[2]]};
    const bool none = id[0] == id[1] || id[1] == id[2] || id[2] == id[0] || (!left_out.empty() && left_out[t] != 0);
    for (int i = 0; i < 3; ++i) {
      const uint32_t a = id[i], b = id[(i + 1) % 3];
      // The sort puts those that are no edges behind all others.
      edges[t * 3 + size_t(i)] = none    ? Edge{UINT32_MAX, UINT32_MAX, uint32_t(t), 0}
                                 : a < b ? Edge{a, b, uint32_t(t), 1}
                                         : Edge{b, a, uint32_t(t), 0};
    }
  };
  absl::Status over =
      ParallelChunks(int64_t(mesh.triangles.size()), int64_t(kElementsAStep), job, [&](int64_t begin, int64_t end) {
        for (int64_t t = begin; t < end; ++t) list(size_t(t));
      });
  if (!over.ok()) return over;
  return edges;
}

// Calls use(first, e) for each edge; `first` is the first of those with the same ends, which follow one another.
template <typename Use>
absl::Status ForEachEdge(const JobContext& job, const std::vector<Edge>& edges, const Use& use) {
  size_t first = 0;
  return InSteps(job, edges.size(), [&](uint64_t begin, uint64_t end) {
    for (size_t e = begin; e < end && edges[e].low != edges[e].high; ++e) {
      if (!edges[e].Joins(edges[first])) first = e;
      use(first, e);
    }
  });
}

uint32_t RootOf(std::vector<uint32_t>& parent, uint32_t t) {
  for (; parent[t] != t; t = parent[t]) parent[t] = parent[parent[t]];
  return t;
}

}  // namespace

absl::StatusOr<ShellList> FindShells(const JobContext& job, const TriangleMesh& mesh, const WeldedVertices& welded,
                                     const std::vector<uint8_t>& left_out) {
  ShellList list;
  list.memory = MemoryCharge(&MemoryOf(job));
  MemoryCharge scratch(&MemoryOf(job));
  constexpr std::string_view kWhat = "the edges and shells of the mesh";
  const uint64_t triangles = mesh.triangles.size();
  if (absl::Status full = scratch.Grow(triangles, 3 * sizeof(Edge), kWhat); !full.ok()) return full;
  if (absl::Status full = list.memory.Grow(triangles, sizeof(uint32_t), kWhat); !full.ok()) return full;
  absl::StatusOr<std::vector<Edge>> listed = ListEdges(job, mesh, welded, left_out);
  if (!listed.ok()) return listed.status();
  std::vector<Edge>& edges = *listed;
  if (absl::Status over = ParallelSort(job, edges); !over.ok()) return over;

  std::vector<uint32_t>& shell_of = list.shell_of;  // first each triangle's parent
  shell_of.reserve(triangles);
  absl::Status over = InSteps(job, triangles, [&](uint64_t begin, uint64_t end) {
    for (uint64_t t = begin; t < end; ++t) shell_of.push_back(uint32_t(t));
  });
  if (!over.ok()) return over;
  over = ForEachEdge(job, edges, [&](size_t first, size_t e) {
    if (e == first) return;
    const uint32_t a = RootOf(shell_of, edges[first].triangle), b = RootOf(shell_of, edges[e].triangle);
    shell_of[std::max(a, b)] = std::min(a, b);
  });
  if (!over.ok()) return over;
  uint64_t roots = 0;  // those without edges among them
  over = InSteps(job, triangles, [&](uint64_t begin, uint64_t end) {
    for (uint32_t t = uint32_t(begin); t < end; ++t) {
      shell_of[t] = RootOf(shell_of, t);
      roots += shell_of[t] == t;
    }
  });
  if (!over.ok()) return over;
  if (absl::Status full = list.memory.Grow(roots, sizeof(Shell), kWhat); !full.ok()) return full;
  list.shells.reserve(roots);
  // A root comes before the others of its shell, so that its place can take the shell's number.
  const auto number = [&](uint32_t t) {
    const auto& corners = mesh.triangles[t];
    const uint32_t a = welded.id[corners[0]], b = welded.id[corners[1]], c = welded.id[corners[2]];
    if (a == b || b == c || c == a || (!left_out.empty() && left_out[t] != 0)) {
      shell_of[t] = kNoShell;
    } else if (shell_of[t] == t) {
      shell_of[t] = uint32_t(list.shells.size());
      list.shells.push_back({.first_triangle = t, .triangles = 1});
    } else {
      shell_of[t] = shell_of[shell_of[t]];
      ++list.shells[shell_of[t]].triangles;
    }
  };
  over = InSteps(job, triangles, [&](uint64_t begin, uint64_t end) {
    for (uint32_t t = uint32_t(begin); t < end; ++t) number(t);
  });
  if (!over.ok()) return over;

  size_t rising = 0;  // of the edges with the same ends so far
  over = ForEachEdge(job, edges, [&](size_t first, size_t e) {
    rising = (e == first ? 0 : rising) + edges[e].rises;
    if (e + 1 < edges.size() && edges[e + 1].Joins(edges[first])) return;
    const size_t uses = e + 1 - first;
    Shell& shell = list.shells[shell_of[edges[first].triangle]];
    ++list.counts.edges;
    list.counts.non_manifold += uses > 2;
    if (uses % 2 == 1) {
      ++list.counts.open;
      shell.closed = shell.oriented = false;
    } else if (2 * rising != uses) {
      ++list.counts.inconsistent;
      shell.oriented = false;
    }
  });
  if (!over.ok()) return over;
  return list;
}

}  // namespace voxelpipe
