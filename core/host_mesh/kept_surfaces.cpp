#include "host_mesh/kept_surfaces.h"

#include <algorithm>
#include <deque>
#include <mutex>
#include <type_traits>
#include <utility>

#include "mesh/content_id.h"
#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxKept = 64;  // of a few KiB each

struct Kept {
  std::mutex mutex;
  std::deque<std::pair<std::string, Surface>> surfaces;  // the oldest first

  auto Find(const std::string& key) {
    return std::find_if(surfaces.begin(), surfaces.end(), [&](const auto& entry) { return entry.first == key; });
  }
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
  const std::string& id = mesh.mesh.content_id;
  // A moved mesh is not measured again: each motion makes a new id.
  if (id.empty() || id.find(kMovedMark) != std::string::npos || own_arrays) return {};
  std::string key;
  Append(closely, key);
  Append(request.coverage, key);
  Append(request.fill, key);
  Append(request.result, key);
  Append(FillsParts(request), key);
  Append(request.grid.given(), key);
  Append(footprint::ValueBytes(request), key);
  Append(footprint::PlainBits(request), key);
  Append(grid.dims, key);
  for (const Vec3d& v : {grid.origin, grid.voxel_size, grid.wall, grid.wall_end}) Append(v, key);
  return key + id;
}

std::optional<Surface> FindSurface(const std::string& key) {
  if (key.empty()) return std::nullopt;
  Kept& kept = Surfaces();
  const std::lock_guard lock(kept.mutex);
  const auto found = kept.Find(key);
  return found == kept.surfaces.end() ? std::nullopt : std::optional(found->second);
}

void KeepSurface(const std::string& key, const Surface& surface) {
  if (key.empty()) return;
  Kept& kept = Surfaces();
  const std::lock_guard lock(kept.mutex);
  if (kept.Find(key) != kept.surfaces.end()) return;  // of two runs at once, the other was first
  if (kept.surfaces.size() >= kMaxKept) kept.surfaces.pop_front();
  kept.surfaces.emplace_back(key, surface);
}

}  // namespace voxelpipe
