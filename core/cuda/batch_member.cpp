#include "cuda/batch_member.h"

#include <algorithm>
#include <utility>

#include "base/wall_clock.h"
#include "cpu/row_kernels.h"
#include "cuda/views.h"
#include "grid/index_space.h"
#include "shaders/mips.h"

namespace voxelpipe::cuda {
namespace {

// A grid or mesh above these fills the device by itself.
constexpr uint64_t kMostWords = 1 << 22;  // 512^3 voxels
constexpr uint64_t kMostTriangles = 1 << 20, kMostVertices = 1 << 24;
// Likewise of items that go by tiles: a block takes a tile whole, and what shaders read goes up with the pass.
constexpr uint64_t kMostTiledTriangles = 1 << 15, kMostTiledVertices = 3 * kMostTiledTriangles;
constexpr uint64_t kMostTargetWords = 1 << 22, kMostTexels = 1 << 20;
// Bricks are made of all voxels on the host; beyond this the device makes them, alone.
constexpr uint64_t kMostVoxelsOfSparse = 1 << 21;

bool InReach(const MeshExtent& extent, const GridSpec& grid) {
  constexpr double kFarthest = 0x1p40;  // as CoarseRaster says, which names the vertex
  for (const Vec3d& corner : {extent.box.min, extent.box.max}) {
    const Vec3d p = WorldToIndex(grid.origin, grid.voxel_size, corner);
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

bool IsSmallForTiles(const BatchMember& member) {
  return member.triangles() <= kMostTiledTriangles && member.vertices() <= kMostTiledVertices &&
         member.target_words() <= kMostTargetWords && Texels(member.host->textures) <= kMostTexels;
}

}  // namespace

uint64_t BatchMember::target_words() const {
  uint64_t words = sparse() ? packed_words() : 0;  // what is occupied
  for (const TargetSpec& spec : request().targets) {
    words += (TargetBytes(spec, plan.grid.voxels()) + 3) / 4;
  }
  return words;
}

std::unique_ptr<BatchMember> PrepareMember(const BatchItem& item, const PlanLimits& limits) {
  const VoxelizeRequest& request = *item.request;
  if (request.result == ResultKind::kBuckets || request.fill == Fill::kFlood) return nullptr;
  if (item.mesh->triangles.size() > kMostTriangles || item.mesh->positions.size() > kMostVertices) return nullptr;
  if (!item.job->Check().ok()) return nullptr;
  absl::StatusOr<BoundRequest> bound = BindRequest(*item.mesh, request);
  const absl::StatusOr<const cpu::RowKernels*> kernels = cpu::SelectRowKernels(request.simd);
  if (!bound.ok() || !kernels.ok()) return nullptr;
  auto member = std::make_unique<BatchMember>();
  member->item = &item;
  member->bound = std::make_unique<BoundRequest>(*std::move(bound));
  member->host = std::make_unique<cpu::RunState>(*item.mesh, *member->bound, *item.job);
  member->host->kernels = *kernels;
  item.job->Report("vertex_shade", 0);
  const double begin = WallMs();
  const absl::StatusOr<MeshExtent> extent = cpu::VertexShade(*member->host);
  if (!extent.ok()) return nullptr;
  member->stats.stages.emplace_back("vertex_shade", WallMs() - begin);
  absl::StatusOr<Plan> plan =
      PlanVoxelization(member->request(), item.mesh->triangles.size(), item.mesh->positions.size(), *extent, limits);
  if (!plan.ok()) return nullptr;
  member->plan = *std::move(plan);
  const GridSpec& grid = member->plan.grid;
  if (member->plan.slab_depth < grid.dims[2]) return nullptr;
  if (member->words() > kMostWords || grid.voxels() > 32 * kMostWords) return nullptr;
  if (member->sparse() && grid.voxels() > kMostVoxelsOfSparse) return nullptr;
  if (member->triangles() > 0 && !InReach(*extent, grid)) return nullptr;
  member->by_rows = cpu::PlainBits(*member->host, grid);
  return member->by_rows || IsSmallForTiles(*member) ? std::move(member) : nullptr;
}

}  // namespace voxelpipe::cuda
