// Decides whether an item can share a pass, and computes the sizes that a pass needs of it.
#include "cuda/batch/batch_member.h"

#include <algorithm>
#include <utility>

#include "base/wall_clock.h"
#include "cuda/run/run_state.h"
#include "grid/index_space.h"
#include "host_mesh/vertex_shade.h"
#include "mesh/views/mips.h"
#include "raster/row_bits_fit.h"

namespace voxelpipe::cuda {
namespace {

// A grid or mesh above these limits fills the device by itself.
constexpr uint64_t kMaxWords = 1 << 22;  // 512^3 voxels
constexpr uint64_t kMaxTriangles = 1 << 20, kMaxVertices = 1 << 24;
// Limits of shaded items: shader inputs are uploaded with the pass.
constexpr uint64_t kMaxShadedTriangles = 1 << 15, kMaxShadedVertices = 3 * kMaxShadedTriangles;
constexpr uint64_t kMaxTargetWords = 1 << 22, kMaxTexels = 1 << 20;
// Limits of flood fills: one block fills a whole grid, with one thread per line, however many multiprocessors are idle.
constexpr uint64_t kMaxFloodWords = 1 << 16;  // 128^3 voxels
constexpr int64_t kMaxFloodLine = 256;        // words or rows
// Limit of fragments.
constexpr uint64_t kMaxBoxVoxels = 1 << 24;
// Bricks are made on the host from all voxels; larger grids run alone, where the device makes them.
constexpr uint64_t kMaxVoxelsOfSparse = 1 << 21;

bool InReach(const MeshExtent& extent, const GridSpec& grid) {
  constexpr double kFarthest = 0x1p40;  // the limit of CoarseRaster, whose error names the vertex
  for (const Vec3d& corner : {extent.box.min, extent.box.max}) {
    const Vec3d p = WorldToIndex(grid.index_space(), corner);
    if (!(Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest)) return false;
  }
  return true;
}

uint64_t Texels(const std::vector<TextureView>& textures) {
  uint64_t texels = 0;
  for (const TextureView& t : textures) {
    if (t.rgba != nullptr) texels += uint64_t{t.width} * t.height;
    if (t.mips != nullptr) texels += 4 * LevelOffset(t.width, t.height, t.levels);  // floats
  }
  return texels;
}

bool IsSmallForShaders(const BatchMember& member) {
  return member.triangles() <= kMaxShadedTriangles && member.vertices() <= kMaxShadedVertices &&
         Texels(member.host->textures) <= kMaxTexels;
}

// Voxels of the bounding boxes of triangles within the grid, with at most five layers each: a plane meets at most that
// many voxels of a column along the dominant axis of its normal. Boxes that end at or just before a voxel border also
// touch the voxels beyond.
uint64_t BoxVoxels(const MeshView& mesh, const GridSpec& grid) {
  constexpr double kNear = 1e-3;  // voxels
  double scale[3], last[3];
  for (int i = 0; i < 3; ++i) {
    scale[i] = 1 / grid.voxel_size[i];
    last[i] = double(grid.dims[size_t(i)] - 1);
  }
  uint64_t voxels = 0;
  for (uint64_t t = 0; t < mesh.triangle_count; ++t) {
    const uint32_t* const v = mesh.triangles[t];
    const Vec3d &a = mesh.positions[v[0]], &b = mesh.positions[v[1]], &c = mesh.positions[v[2]];
    int64_t box = 1, least = INT64_MAX;
    for (int i = 0; i < 3; ++i) {
      const double lo = Min(a[i], Min(b[i], c[i])), hi = Max(a[i], Max(b[i], c[i]));
      const double begin = Clamp((lo - grid.origin[i]) * scale[i] - kNear, 0.0, last[i]);
      const double end = Clamp((hi - grid.origin[i]) * scale[i] + kNear, 0.0, last[i]);
      const int64_t side = int64_t(end) - int64_t(begin) + 1;
      box *= side;
      least = std::min(least, side);
    }
    voxels += uint64_t(least <= 5 ? box : box / least * 5);
  }
  return voxels;
}

}  // namespace

bool BatchMember::own_shell() const {
  if (!flood()) return false;
  // If all targets' shaders can discard, discarded fragments are not covered but still belong to the closed shell.
  const bool all_drop = std::all_of(bound->fragment_shaders.begin(), bound->fragment_shaders.end(),
                                    [](const BoundShader& shader) { return shader.info->can_discard; });
  return all_drop || request().coverage != Coverage::kConservative;
}

int BatchMember::order() const {
  const int with_flood = !flood() ? 0 : own_shell() ? 2 : 1;
  switch (path) {
    case BatchPath::kRows: return with_flood;
    case BatchPath::kValues: return 5 - with_flood;
    default: return 6;
  }
}

uint64_t BatchMember::grid_words() const {
  // Coverage, inside, shell, two grids per target; for values also ranks and touched voxels.
  const uint64_t grids = 2 + (own_shell() ? 1 : 0) + 2 * request().targets.size();
  return words() * (path == BatchPath::kValues ? grids + 3 : grids);
}

uint64_t BatchMember::target_words() const {
  uint64_t words = sparse() ? packed_words() : 0;  // occupied voxels
  for (const TargetSpec& spec : request().targets) {
    words += (TargetBytes(spec, plan.grid.voxels()) + 3) / 4;
  }
  return words;
}

uint64_t BatchMember::fragment_words() const {
  uint64_t of_each = 3;  // its triangle; its voxel and offset, in case it is alone in its voxel
  for (const TargetSpec& spec : request().targets) {
    const uint64_t accumulated = 2 * uint64_t(spec.components) + 1;  // sums and the fragment count
    of_each += path == BatchPath::kValues ? accumulated : (TargetBytes(spec, 1) + 3) / 4;
  }
  return box_voxels * of_each;
}

std::unique_ptr<BatchMember> PrepareMember(const Backend& backend, const BatchItem& item, const PlanLimits& limits) {
  const VoxelizeRequest& request = *item.request;
  if (item.mesh->triangles.size() > kMaxTriangles || item.mesh->positions.size() > kMaxVertices) return nullptr;
  if (!item.job->Check().ok()) return nullptr;
  if (request.coverage == Coverage::kNone || request.fill == Fill::kNonzero) return nullptr;  // not supported by passes
  if (request.parts != PartSelection()) return nullptr;                                       // neither
  absl::StatusOr<BoundRequest> bound = BindRequest(*item.job, *item.mesh, request);
  if (!bound.ok()) return nullptr;
  auto member = std::make_unique<BatchMember>();
  member->item = &item;
  member->bound = std::make_unique<BoundRequest>(*std::move(bound));
  member->host = std::make_unique<HostMesh>(*item.mesh, *member->bound, *item.job);
  item.job->Report("vertex_shade", 0);
  const double begin = WallMs();
  const absl::StatusOr<MeshExtent> extent = ShadeHostMesh(*member->host);
  if (!extent.ok()) return nullptr;
  member->stats.triangles_outside = extent->triangles_outside;
  member->stats.stages.emplace_back("vertex_shade", WallMs() - begin);
  const MeshSize size{item.mesh->triangles.size(), item.mesh->positions.size(), *extent};
  const auto measure = [&](const GridSpec& grid, bool) -> absl::StatusOr<Surface> {
    return EstimateSurface(member->request(), grid, size);
  };
  const double planning = WallMs();
  absl::StatusOr<PlannedRun> planned = PlanOn({backend, member->request(), size, measure, limits, Delivery::kMemory});
  if (!planned.ok()) return nullptr;
  member->stats.stages.emplace_back("plan", WallMs() - planning);
  member->plan = std::move(planned->plan);
  const GridSpec& grid = member->plan.grid;
  if (member->plan.slab_depth < grid.dims[2]) return nullptr;
  if (member->words() > kMaxWords || grid.voxels() > 32 * kMaxWords) return nullptr;
  if (member->flood()) {
    const int64_t line = std::max({(grid.dims[0] + 31) / 32, grid.dims[1], grid.dims[2]});
    if (member->words() > kMaxFloodWords || line > kMaxFloodLine) return nullptr;
  }
  if (member->sparse() && grid.voxels() > kMaxVoxelsOfSparse) return nullptr;
  if (member->triangles() > 0 && !InReach(*extent, grid)) return nullptr;
  if (request.result == ResultKind::kBuckets) {
    member->path = BatchPath::kFragments;
    if (ShadesFragments(*member->bound) && !IsSmallForShaders(*member)) return nullptr;
    member->box_voxels = BoxVoxels(member->host->view, grid);
    return member->box_voxels <= kMaxBoxVoxels ? std::move(member) : nullptr;
  }
  if (!ShadesFragments(*member->bound) && RowBitsFit(grid, member->triangles())) return member;
  member->path = BatchPath::kValues;
  if (!IsSmallForShaders(*member) || member->target_words() > kMaxTargetWords) return nullptr;
  member->box_voxels = BoxVoxels(member->host->view, grid);
  return member->box_voxels <= kMaxBoxVoxels ? std::move(member) : nullptr;
}

}  // namespace voxelpipe::cuda
