#include "host_mesh/order_parts.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/long_loops.h"

namespace voxelpipe {

absl::StatusOr<bool> OrderRunsByParts(HostMesh& state) {
  const TriangleMesh& mesh = state.mesh;
  const PartList& list = *state.request.parts;
  std::vector<uint32_t> order;
  order.reserve(mesh.parts.size());
  for (uint32_t run = 0; run < mesh.parts.size(); ++run) {
    if (mesh.parts[run].triangle_count > 0) order.push_back(run);
  }
  if (order.empty()) return true;
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return list.parts[list.of_run[a]].rank < list.parts[list.of_run[b]].rank;
  });
  std::vector<PartView> views;
  views.reserve(order.size());
  uint64_t first = 0;
  bool in_order = true;
  for (const uint32_t run : order) {
    const MeshPart& part = mesh.parts[run];
    PartView view = state.parts[run];
    view.first_triangle = first;
    view.id_offset = uint32_t(part.first_triangle) - uint32_t(first);
    view.rank = list.parts[list.of_run[run]].rank + 1;
    in_order = in_order && part.first_triangle == first;
    first += part.triangle_count;
    views.push_back(view);
  }
  state.parts = std::move(views);
  state.view.parts = state.parts.data();
  state.view.part_count = uint32_t(state.parts.size());
  if (absl::Status over = state.job.Check(); !over.ok()) return over;
  return in_order;
}

absl::Status OrderByParts(HostMesh& state) {
  const TriangleMesh& mesh = state.mesh;
  const absl::StatusOr<bool> in_order = OrderRunsByParts(state);
  if (!in_order.ok()) return in_order.status();
  if (*in_order) return absl::OkStatus();
  state.order_memory = MemoryCharge(&MemoryOf(state.job));
  const uint64_t bytes = mesh.triangles.size() * sizeof(mesh.triangles[0]);
  if (absl::Status full = state.order_memory.Grow(bytes, "the mesh's triangles by parts"); !full.ok()) return full;
  state.ordered_triangles.reserve(mesh.triangles.size());
  for (size_t i = 0; i < state.parts.size(); ++i) {
    const uint64_t first = state.parts[i].first_triangle;
    const uint64_t next = i + 1 < state.parts.size() ? state.parts[i + 1].first_triangle : mesh.triangles.size();
    const auto from = mesh.triangles.begin() + ptrdiff_t(uint32_t(first) + state.parts[i].id_offset);
    absl::Status over = InSteps(state.job, next - first, [&](uint64_t begin, uint64_t end) {
      state.ordered_triangles.insert(state.ordered_triangles.end(), from + ptrdiff_t(begin), from + ptrdiff_t(end));
    });
    if (!over.ok()) return over;
  }
  state.view.triangles = reinterpret_cast<const uint32_t(*)[3]>(state.ordered_triangles.data());
  return absl::OkStatus();
}

}  // namespace voxelpipe
