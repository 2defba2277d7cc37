#include "host_mesh/kept_surfaces.h"

#include <algorithm>
#include <deque>
#include <mutex>
#include <type_traits>
#include <utility>

#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxKept = 64;  // of a few KiB each

struct Kept {
  std::mutex mutex;
  std::deque<std::pair<std::string, Surface>> surfaces;  // the oldest first
};

Kept& Surfaces() {
  static auto* const kept = new Kept;
  return *kept;
}

template <typename Number>
void Append(const Number& number, std::string& key) {
  static_assert(std::is_trivially_copyable_v<Number>);
  key.append(reinterpret_cast<const char*>(&number), sizeof(number));
}

}  // namespace

std::string SurfaceKey(const HostMesh& mesh, const GridSpec& grid, bool closely) {
  const MeshView& view = mesh.view;
  const VoxelizeRequest& request = mesh.request.request;
  const bool own_arrays = view.positions != mesh.mesh.positions.data() || !mesh.ordered_triangles.empty();
  if (mesh.mesh.content_id.empty() || own_arrays) return {};
  std::string key;
  Append(closely, key);
  Append(request.coverage, key);
  Append(request.fill, key);
  Append(request.result, key);
  Append(FillsParts(request), key);
  Append(request.grid.given(), key);
  Append(footprint::ValueBytes(request), key);
  Append(grid.dims, key);
  for (const Vec3d& v : {grid.origin, grid.voxel_size, grid.wall, grid.wall_end}) Append(v, key);
  return key + mesh.mesh.content_id;
}

std::optional<Surface> FindSurface(const std::string& key) {
  if (key.empty()) return std::nullopt;
  Kept& kept = Surfaces();
  const std::lock_guard lock(kept.mutex);
  const auto found =
      std::find_if(kept.surfaces.begin(), kept.surfaces.end(), [&](const auto& entry) { return entry.first == key; });
  return found == kept.surfaces.end() ? std::nullopt : std::optional(found->second);
}

void KeepSurface(const std::string& key, const Surface& surface) {
  if (key.empty()) return;
  Kept& kept = Surfaces();
  const std::lock_guard lock(kept.mutex);
  if (kept.surfaces.size() >= kMaxKept) kept.surfaces.pop_front();
  kept.surfaces.emplace_back(key, surface);
}

}  // namespace voxelpipe
