#include "mesh/parts/open_edges.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <new>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "base/memory_budget.h"
#include "base/parallel.h"
#include "mesh/report.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kTrianglesAStep = 1 << 13;  // between two polls of the job
// Of the hash tables, at their largest: while they grow, the old one and one of twice its size.
constexpr uint64_t kVertexBytes = sizeof(uint32_t) + 3 * 40, kEdgeBytes = 32;

using Runs = std::vector<std::vector<uint32_t>>;  // of each part, in order

Runs RunsOf(const TriangleMesh& mesh, const PartList& list) {
  Runs runs(list.parts.size());
  for (uint32_t run = 0; run < mesh.parts.size(); ++run) {
    if (mesh.parts[run].triangle_count > 0) runs[list.of_run[run]].push_back(run);
  }
  return runs;
}

// Equal positions have equal bits: -0 becomes +0.
std::array<uint64_t, 3> BitsOf(const Vec3d& p) {
  return {std::bit_cast<uint64_t>(p.x + 0.0), std::bit_cast<uint64_t>(p.y + 0.0), std::bit_cast<uint64_t>(p.z + 0.0)};
}

// One part at a time.
class EdgesOfPart {
 public:
  EdgesOfPart(const JobContext& job, const TriangleMesh& mesh) : job_(job), mesh_(mesh), charge_(&MemoryOf(job)) {}

  absl::StatusOr<uint64_t> Count(const std::vector<uint32_t>& runs) {
    uint64_t vertices = 0, triangles = 0;
    for (const uint32_t run : runs) {
      vertices += mesh_.parts[run].vertex_count;
      triangles += mesh_.parts[run].triangle_count;
    }
    // All edges of a part may be open. The largest part so far: its tables may be kept.
    const uint64_t bytes = vertices * kVertexBytes + 3 * triangles * kEdgeBytes;
    const uint64_t more = bytes - std::min(bytes, charge_.bytes());
    if (absl::Status full = charge_.Grow(more, "looking for open edges"); !full.ok()) return full;
    positions_.clear();
    odd_.clear();
    for (const uint32_t run : runs) {
      if (absl::Status s = Add(mesh_.parts[run]); !s.ok()) return s;
    }
    return odd_.size();
  }

 private:
  absl::Status Add(const MeshPart& run) {
    ids_.resize(run.vertex_count);
    for (uint64_t i = 0; i < run.vertex_count; ++i) {
      if (i % kTrianglesAStep == 0) {
        if (absl::Status over = job_.Check(); !over.ok()) return over;
      }
      const std::array<uint64_t, 3> bits = BitsOf(mesh_.positions[run.first_vertex + i]);
      ids_[i] = positions_.try_emplace(bits, uint32_t(positions_.size())).first->second;
    }
    for (uint64_t t = 0; t < run.triangle_count; ++t) {
      if (t % kTrianglesAStep == 0) {
        if (absl::Status over = job_.Check(); !over.ok()) return over;
      }
      const std::array<uint32_t, 3>& corners = mesh_.triangles[run.first_triangle + t];
      for (size_t i = 0; i < 3; ++i) {
        const uint64_t a = ids_[corners[i] - run.first_vertex], b = ids_[corners[(i + 1) % 3] - run.first_vertex];
        if (a == b) continue;
        const auto [at, fresh] = odd_.insert(a < b ? a << 32 | b : b << 32 | a);
        if (!fresh) odd_.erase(at);
      }
    }
    return absl::OkStatus();
  }

  const JobContext& job_;
  const TriangleMesh& mesh_;
  MemoryCharge charge_;
  absl::flat_hash_map<std::array<uint64_t, 3>, uint32_t> positions_;
  absl::flat_hash_set<uint64_t> odd_;  // edges used an odd number of times so far
  std::vector<uint32_t> ids_;          // of a run's vertices
};

bool AreKnown(const TriangleMesh& mesh) {
  return !mesh.placed.empty() && std::all_of(mesh.placed.begin(), mesh.placed.end(),
                                             [](const PlacedEntry& placed) { return placed.open_edges.has_value(); });
}

}  // namespace

absl::StatusOr<std::vector<uint64_t>> CountOpenEdges(const JobContext& job, const TriangleMesh& mesh,
                                                     const PartList& list, PartScope scope) {
  if (scope == PartScope::kFile && AreKnown(mesh)) {
    std::vector<uint64_t> open;
    for (const Part& part : list.parts) open.push_back(*mesh.placed[part.placed].open_edges);
    return open;
  }
  if (list.parts.size() == 1) {  // by all threads
    const absl::StatusOr<uint64_t> open = CountOpenEdges(job, mesh);
    if (!open.ok()) return open.status();
    return std::vector<uint64_t>{*open};
  }
  try {
    const Runs runs = RunsOf(mesh, list);
    std::vector<uint64_t> open(runs.size());
    struct Worker {
      EdgesOfPart edges;
      absl::Status status;
    };
    tbb::enumerable_thread_specific<Worker> workers([&] { return Worker{EdgesOfPart(job, mesh), absl::OkStatus()}; });
    absl::Status over = ParallelChunks(int64_t(runs.size()), 1, job, [&](int64_t begin, int64_t end) {
      Worker& worker = workers.local();
      for (int64_t part = begin; part < end && worker.status.ok(); ++part) {
        const absl::StatusOr<uint64_t> count = worker.edges.Count(runs[size_t(part)]);
        worker.status.Update(count.status());
        if (count.ok()) open[size_t(part)] = *count;
      }
    });
    for (const Worker& worker : workers) over.Update(worker.status);
    if (!over.ok()) return over;
    return open;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while looking for open edges");
  }
}

}  // namespace voxelpipe
