#include "host_mesh/order_parts.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/long_loops.h"

namespace voxelpipe {

absl::Status OrderByParts(HostMesh& state) {
  const TriangleMesh& mesh = state.mesh;
  const PartList& list = *state.request.parts;
  if (mesh.triangles.empty()) return absl::OkStatus();
  state.order_memory = MemoryCharge(&MemoryOf(state.job));
  const uint64_t bytes = mesh.triangles.size() * sizeof(mesh.triangles[0]) + mesh.parts.size() * sizeof(uint32_t);
  if (absl::Status full = state.order_memory.Grow(bytes, "the mesh's triangles by parts"); !full.ok()) return full;
  std::vector<uint32_t> order;
  order.reserve(mesh.parts.size());
  for (uint32_t run = 0; run < mesh.parts.size(); ++run) {
    if (mesh.parts[run].triangle_count > 0) order.push_back(run);
  }
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return list.parts[list.of_run[a]].rank < list.parts[list.of_run[b]].rank;
  });
  state.ordered_triangles.reserve(mesh.triangles.size());
  std::vector<PartView> views;
  views.reserve(order.size());
  for (const uint32_t run : order) {
    const MeshPart& part = mesh.parts[run];
    PartView view = state.parts[run];
    view.first_triangle = state.ordered_triangles.size();
    view.id_offset = uint32_t(part.first_triangle) - uint32_t(view.first_triangle);
    view.rank = list.parts[list.of_run[run]].rank + 1;
    views.push_back(view);
    const auto from = mesh.triangles.begin() + ptrdiff_t(part.first_triangle);
    absl::Status over = InSteps(state.job, part.triangle_count, [&](uint64_t begin, uint64_t end) {
      state.ordered_triangles.insert(state.ordered_triangles.end(), from + ptrdiff_t(begin), from + ptrdiff_t(end));
    });
    if (!over.ok()) return over;
  }
  state.parts = std::move(views);
  state.view.parts = state.parts.data();
  state.view.part_count = uint32_t(state.parts.size());
  state.view.triangles = reinterpret_cast<const uint32_t(*)[3]>(state.ordered_triangles.data());
  return absl::OkStatus();
}

}  // namespace voxelpipe
