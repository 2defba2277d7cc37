#include "mesh/unused_vertices.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>

namespace voxelpipe {
namespace {

constexpr size_t kVertexGrain = 1 << 13;

}  // namespace

absl::StatusOr<std::vector<uint32_t>> UnusedVertices(const JobContext& job, const TriangleMesh& mesh) {
  std::vector<uint8_t> used(mesh.positions.size());
  tbb::parallel_for(tbb::blocked_range<size_t>(0, mesh.triangles.size(), kVertexGrain), [&](const auto& range) {
    if (!job.Check().ok()) return;
    for (size_t t = range.begin(); t < range.end(); ++t) {
      for (const uint32_t v : mesh.triangles[t]) std::atomic_ref<uint8_t>(used[v]).store(1, std::memory_order_relaxed);
    }
  });
  const auto count = std::count(used.begin(), used.end(), 0);
  if (absl::Status full = mesh.memory->Grow(uint64_t(count), sizeof(uint32_t), "the mesh's unused vertices");
      !full.ok()) {
    return full;
  }
  std::vector<uint32_t> unused;
  unused.reserve(size_t(count));
  for (size_t begin = 0; begin < used.size() && job.Check().ok(); begin += kVertexGrain) {
    const size_t end = std::min(used.size(), begin + kVertexGrain);
    for (size_t v = begin; v < end; ++v) {
      if (used[v] == 0) unused.push_back(uint32_t(v));
    }
  }
  return unused;
}

}  // namespace voxelpipe
