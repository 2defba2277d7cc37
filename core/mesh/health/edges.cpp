// Source: B. A. Galler, M. J. Fischer, "An improved equivalence algorithm", 1964 (the forest of shells), with the
// smaller id as the root, so that the result does not depend on the order of the edges.
#include "mesh/health/edges.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <numeric>
#include <string_view>
#include <tuple>
#include <utility>

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

std::vector<Edge> ListEdges(const TriangleMesh& mesh, const WeldedVertices& welded,
                            const std::vector<uint8_t>& left_out) {
  std::vector<Edge> edges(mesh.triangles.size() * 3);
  tbb::parallel_for(size_t{0}, mesh.triangles.size(), [&](size_t t) {
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
  });
  return edges;
}

// Calls use(begin, end) for the edges of each pair of ends.
template <typename Use>
absl::Status ForEachEdge(const JobContext& job, const std::vector<Edge>& edges, const Use& use) {
  constexpr size_t kBetweenChecks = 1 << 16;
  size_t next_check = 0;
  for (size_t begin = 0; begin < edges.size() && edges[begin].low != edges[begin].high;) {
    if (begin >= next_check) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
      next_check = begin + kBetweenChecks;
    }
    size_t end = begin + 1;
    while (end < edges.size() && edges[end].Joins(edges[begin])) ++end;
    use(begin, end);
    begin = end;
  }
  return absl::OkStatus();
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
  std::vector<Edge> edges = ListEdges(mesh, welded, left_out);
  if (absl::Status over = job.Check(); !over.ok()) return over;
  tbb::parallel_sort(edges.begin(), edges.end());

  std::vector<uint32_t>& shell_of = list.shell_of;  // first each triangle's parent
  shell_of.resize(mesh.triangles.size());
  std::iota(shell_of.begin(), shell_of.end(), 0u);
  absl::Status over = ForEachEdge(job, edges, [&](size_t begin, size_t end) {
    for (size_t e = begin + 1; e < end; ++e) {
      const uint32_t a = RootOf(shell_of, edges[begin].triangle), b = RootOf(shell_of, edges[e].triangle);
      shell_of[std::max(a, b)] = std::min(a, b);
    }
  });
  if (!over.ok()) return over;
  uint64_t roots = 0;  // those without edges among them
  for (uint32_t t = 0; t < shell_of.size(); ++t) {
    shell_of[t] = RootOf(shell_of, t);
    roots += shell_of[t] == t;
  }
  if (absl::Status full = list.memory.Grow(roots, sizeof(Shell), kWhat); !full.ok()) return full;
  list.shells.reserve(roots);
  // A root comes before the others of its shell, so that its place can take the shell's number.
  for (uint32_t t = 0; t < shell_of.size(); ++t) {
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
  }

  over = ForEachEdge(job, edges, [&](size_t begin, size_t end) {
    const size_t uses = end - begin;
    size_t rising = 0;
    for (size_t e = begin; e < end; ++e) rising += edges[e].rises;
    Shell& shell = list.shells[shell_of[edges[begin].triangle]];
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
