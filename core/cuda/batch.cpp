#include "cuda/batch.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <ctime>
#include <memory>
#include <new>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "cpu/row_kernels.h"
#include "cpu/run_state.h"
#include "cuda/batch_bricks.h"
#include "cuda/mesh_cache.h"
#include "cuda/mesh_uploads.h"
#include "cuda/pinned.h"
#include "grid/index_space.h"
#include "mesh/content_id.h"
#include "pipeline/bind.h"

namespace voxelpipe::cuda {
namespace {

// A grid or mesh above these fills the device by itself.
constexpr uint64_t kMostWordsOfItem = 1 << 22;  // 512^3 voxels
constexpr uint64_t kMostTrianglesOfItem = 1 << 20;
// Bricks are made of all bits on the host; beyond this the device makes them, alone.
constexpr uint64_t kMostVoxelsOfSparse = 1 << 21;
// A pass ends where the next item would go beyond; the rest of the items take another one.
constexpr uint64_t kMostWords = 1 << 26, kMostTriangles = 1 << 24, kMostVertices = 1 << 24;

double WallMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double CpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

// An item that shares a pass.
struct Member {
  const BatchItem* item = nullptr;
  std::unique_ptr<BoundRequest> bound;
  std::unique_ptr<cpu::RunState> host;  // refers to `bound`
  Plan plan;
  VoxelizeStats stats;

  const VoxelizeRequest& request() const { return bound->request; }
  uint64_t triangles() const { return host->view.triangle_count; }
  uint64_t vertices() const { return host->view.vertex_count; }
  uint64_t rows() const { return uint64_t(plan.grid.dims[1]) * uint64_t(plan.grid.dims[2]); }
  uint64_t words() const { return rows() * uint64_t((plan.grid.dims[0] + 31) / 32); }
  uint64_t packed_words() const { return (plan.grid.voxels() + 31) / 32; }  // of one target
  bool sparse() const { return request().result == ResultKind::kSparse; }
  uint64_t column_words() const {  // of all layers
    return request().fill == Fill::kParity ? uint64_t((plan.grid.dims[1] + 31) / 32) * uint64_t(plan.grid.dims[2]) : 0;
  }
};

// What can be said before any work.
bool MayShare(const BatchItem& item) {
  const VoxelizeRequest& request = *item.request;
  if (request.result == ResultKind::kBuckets || request.fill == Fill::kFlood) return false;
  if (item.mesh->triangles.size() > kMostTrianglesOfItem || item.mesh->positions.size() > kMostVertices) return false;
  return std::all_of(request.targets.begin(), request.targets.end(),
                     [](const TargetSpec& target) { return target.format == VoxelFormat::kBit; });
}

bool InReach(const MeshExtent& extent, const GridSpec& grid) {
  constexpr double kFarthest = 0x1p40;  // as CoarseRaster says, which names the vertex
  for (const Vec3d& corner : {extent.box.min, extent.box.max}) {
    const Vec3d p = WorldToIndex(grid.origin, grid.voxel_size, corner);
    if (!(Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest)) return false;
  }
  return true;
}

// Shades the item's vertices and plans. Null where it cannot share a pass or something is wrong with it: alone it says what.
std::unique_ptr<Member> Prepare(const BatchItem& item, const PlanLimits& limits) {
  if (!MayShare(item) || !item.job->Check().ok()) return nullptr;
  absl::StatusOr<BoundRequest> bound = BindRequest(*item.mesh, *item.request);
  const absl::StatusOr<const cpu::RowKernels*> kernels = cpu::SelectRowKernels(item.request->simd);
  if (!bound.ok() || !kernels.ok()) return nullptr;
  auto member = std::make_unique<Member>();
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
  if (member->plan.slab_depth < grid.dims[2] || !cpu::PlainBits(*member->host, grid)) return nullptr;
  if (member->words() > kMostWordsOfItem || grid.voxels() > 32 * kMostWordsOfItem) return nullptr;
  if (member->sparse() && grid.voxels() > kMostVoxelsOfSparse) return nullptr;
  if (member->triangles() > 0 && !InReach(*extent, grid)) return nullptr;
  return member;
}

// Places for arrays behind each other in one block of memory, each at a multiple of 16 bytes.
class Layout {
 public:
  template <typename T>
  uint64_t Add(uint64_t count) {
    const uint64_t begin = bytes_;
    bytes_ += (count * sizeof(T) + 15) / 16 * 16;
    return begin;
  }
  uint64_t bytes() const { return bytes_; }

 private:
  uint64_t bytes_ = 0;
};

template <typename T>
T* At(DeviceArray<uint8_t>& block, uint64_t offset) {
  return reinterpret_cast<T*>(block.data() + offset);
}

class Pass {
 public:
  Pass(const DeviceInfo& device, DeviceUse use, std::span<const std::unique_ptr<Member>> members)
      : members_(members), use_(std::move(use)) {
    state_.device = device;
    state_.stream = use_.stream();
  }
  ~Pass() { use_.Wait(); }  // before what its work reads and writes is released

  absl::Status Run() {
    VOXELPIPE_OK_OR_RETURN(Upload());
    VOXELPIPE_OK_OR_RETURN(Allocate());
    VOXELPIPE_OK_OR_RETURN(RasterBatch(state_));
    VOXELPIPE_OK_OR_RETURN(FillBatch(state_));
    VOXELPIPE_OK_OR_RETURN(PackBatch(state_));
    absl::StatusOr<PinnedBuffer> back = PinnedBuffer::Take(result_bytes_ + 8);  // BricksOfBits reads beyond the end
    if (!back.ok()) return back.status();
    back_ = *std::move(back);
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemcpyAsync(back_.data(), state_.view.counts, result_bytes_, cudaMemcpyDeviceToHost, state_.stream));
    VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state_.stream));
    return absl::OkStatus();
  }

  // The result of a member; after Run.
  absl::StatusOr<VoxelizeResult> Cut(size_t number) {
    Member& member = *members_[number];
    if (absl::Status s = member.item->job->Check(); !s.ok()) return s;
    VoxelizeResult result;
    result.kind = member.request().result;
    result.grid = member.plan.grid;
    result.layout = member.request().layout;
    result.specs = member.request().targets;
    const auto* const packed = reinterpret_cast<const uint32_t*>(back_.data() + packed_offset_);
    if (member.sparse()) {
      const auto bits = [&](uint32_t t) {
        return reinterpret_cast<const uint8_t*>(packed + targets_[first_target_[number] + t].first_packed);
      };
      const uint8_t* const covered = member.request().fill == Fill::kNone ? nullptr : bits(1);
      if (absl::Status s = BricksOfBits(bits(0), covered, result); !s.ok()) return s;
    }
    for (uint32_t t = first_target_[number]; t < first_target_[number + 1] && !member.sparse(); ++t) {
      absl::StatusOr<HostBuffer> bits = HostBuffer::Allocate((member.plan.grid.voxels() + 7) / 8);
      if (!bits.ok()) return bits.status();
      std::memcpy(bits->data(), packed + targets_[t].first_packed, bits->size());
      result.targets.push_back(*std::move(bits));
    }
    BatchCounts counts;
    std::memcpy(&counts, back_.data() + number * sizeof counts, sizeof counts);
    result.stats = std::move(member.stats);
    result.stats.triangles = member.triangles();
    result.stats.occupied = counts.occupied;
    if (member.request().fill == Fill::kParity) result.stats.odd_columns = counts.odd_columns;
    result.stats.backend = result.stats.simd = "cuda";
    return result;
  }

 private:
  // The members' descriptions and meshes go up in one copy.
  absl::Status Upload() {
    BatchView& view = state_.view;
    view.item_count = uint32_t(members_.size());
    Layout layout;
    std::vector<BatchItemView> items;
    uint64_t words = 0, columns = 0;
    for (const auto& member : members_) {
      const GridSpec& grid = member->plan.grid;
      BatchItemView item;
      for (int a = 0; a < 3; ++a) item.grid.dims[a] = grid.dims[size_t(a)];
      item.grid.slab_end = item.grid.dims[2];
      item.grid.tiles = TilesOf(item.grid.dims);
      item.grid.words_per_row = (item.grid.dims[0] + 31) / 32;
      item.grid.origin = grid.origin;
      item.grid.voxel_size = grid.voxel_size;
      item.coverage = member->request().coverage;
      item.parity = member->request().fill == Fill::kParity;
      const int64_t* const d = item.grid.dims;
      item.look_first = member->triangles() > 16 * uint64_t(d[0] * d[1] + d[1] * d[2] + d[2] * d[0]);
      item.first_vertex = view.vertex_count;
      item.first_triangle = view.triangle_count;
      item.first_row = view.row_count;
      item.first_word = words;
      item.first_column = columns;
      item.words = member->words();
      item.column_words = item.parity ? (item.grid.dims[1] + 31) / 32 : 0;
      view.vertex_count += member->vertices();
      view.triangle_count += member->triangles();
      view.row_count += member->rows();
      view.any_parity = view.any_parity || item.parity;
      words += item.words;
      columns += member->column_words();
      first_target_.push_back(uint32_t(targets_.size()));
      const auto add_target = [&](bool clear, bool fill) {
        BatchTargetView target;
        target.item = uint32_t(items.size());
        target.clear = clear ? ~0u : 0;
        target.fill = fill ? ~0u : 0;
        target.first_packed = view.packed_words;
        target.voxels = grid.voxels();
        view.packed_words += member->packed_words();
        targets_.push_back(target);
      };
      if (member->sparse()) {
        add_target(false, true);                    // what is occupied
        if (item.parity) add_target(false, false);  // what has a fragment
      } else {
        for (const TargetSpec& spec : member->request().targets) add_target(spec.clear != 0, spec.fill_value != 0);
      }
      items.push_back(item);
    }
    first_target_.push_back(uint32_t(targets_.size()));
    view.target_count = uint32_t(targets_.size());
    words_ = words;
    columns_ = columns;
    const uint64_t items_at = layout.Add<BatchItemView>(items.size());
    const uint64_t targets_at = layout.Add<BatchTargetView>(targets_.size());
    // Meshes that have an id may be there already; the others go up with the descriptions.
    struct Offsets {
      uint64_t positions = 0, triangles = 0;
    };
    std::vector<Offsets> offsets(items.size());
    for (size_t i = 0; i < items.size(); ++i) {
      VOXELPIPE_OK_OR_RETURN(FindKept(*members_[i], items[i]));
      if (items[i].positions == nullptr) offsets[i].positions = layout.Add<Vec3d>(members_[i]->vertices());
      if (items[i].triangles == nullptr) offsets[i].triangles = layout.Add<uint32_t>(3 * members_[i]->triangles());
    }
    absl::StatusOr<PinnedBuffer> staging = PinnedBuffer::Take(layout.bytes());
    if (!staging.ok()) return staging.status();
    staging_ = *std::move(staging);
    VOXELPIPE_OK_OR_RETURN(there_.Resize(layout.bytes(), state_.stream));
    tbb::parallel_for(size_t{0}, items.size(), [&](size_t i) {
      BatchItemView& item = items[i];
      const MeshView& mesh = members_[i]->host->view;
      const auto put = [&](uint64_t offset, const void* from, uint64_t bytes) {
        if (bytes > 0) std::memcpy(staging_.data() + offset, from, bytes);
      };
      if (item.positions == nullptr) {
        put(offsets[i].positions, mesh.positions, mesh.vertex_count * sizeof(Vec3d));
        CountMeshUpload(state_.device.ordinal, mesh.vertex_count * sizeof(Vec3d));
        item.positions = At<Vec3d>(there_, offsets[i].positions);
      }
      if (item.triangles == nullptr) {
        put(offsets[i].triangles, mesh.triangles, mesh.triangle_count * 3 * sizeof(uint32_t));
        CountMeshUpload(state_.device.ordinal, mesh.triangle_count * 3 * sizeof(uint32_t));
        item.triangles = At<uint32_t>(there_, offsets[i].triangles);
      }
      put(items_at + i * sizeof item, &item, sizeof item);
    });
    std::memcpy(staging_.data() + targets_at, targets_.data(), targets_.size() * sizeof targets_[0]);
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemcpyAsync(there_.data(), staging_.data(), layout.bytes(), cudaMemcpyHostToDevice, state_.stream));
    view.items = At<BatchItemView>(there_, items_at);
    view.targets = At<BatchTargetView>(there_, targets_at);
    return absl::OkStatus();
  }

  // Where the device keeps the member's mesh, or is to keep it; null where it goes up with the pass.
  absl::Status FindKept(const Member& member, BatchItemView& item) {
    const TriangleMesh& mesh = *member.item->mesh;
    const MeshView& view = member.host->view;
    const SharedArrays shared = SharedArraysOf(mesh.content_id);
    if (shared.id.empty() || mesh.triangles.empty()) return absl::OkStatus();
    const auto find = [&](const char* part, const void* from, uint64_t bytes) -> absl::StatusOr<const uint8_t*> {
      auto array =
          CachedUpload(state_.device.ordinal, absl::StrCat(shared.id, "/", part), from, bytes, state_.stream, staged_);
      if (!array.ok()) return array.status();
      kept_.push_back(*std::move(array));
      return kept_.back()->data();
    };
    if (view.positions == mesh.positions.data() && shared.positions) {
      const auto positions = find("positions", view.positions, view.vertex_count * sizeof(Vec3d));
      if (!positions.ok()) return positions.status();
      item.positions = reinterpret_cast<const Vec3d*>(*positions);
    }
    const auto triangles = find("triangles", view.triangles, view.triangle_count * 3 * sizeof(uint32_t));
    if (!triangles.ok()) return triangles.status();
    item.triangles = reinterpret_cast<const uint32_t*>(*triangles);
    return absl::OkStatus();
  }

  absl::Status Allocate() {
    BatchView& view = state_.view;
    Layout layout;
    const uint64_t placed = layout.Add<Vec3d>(view.vertex_count), codes = layout.Add<VertexCode>(view.vertex_count);
    const uint64_t triangles = layout.Add<uint32_t>(3 * view.triangle_count);
    const uint64_t item_of = layout.Add<uint32_t>(view.triangle_count);
    uint64_t queue[3];
    for (uint64_t& q : queue) q = layout.Add<uint32_t>(view.triangle_count);
    const uint64_t queued = layout.Add<uint64_t>(8);
    const uint64_t bits = layout.Add<uint32_t>(words_);
    const uint64_t inside = layout.Add<uint32_t>(view.any_parity ? words_ : 0);
    const uint64_t columns = layout.Add<uint32_t>(columns_);
    const uint64_t counts = layout.Add<BatchCounts>(view.item_count);
    const uint64_t packed = layout.Add<uint32_t>(view.packed_words);
    VOXELPIPE_OK_OR_RETURN(work_.Resize(layout.bytes(), state_.stream));
    view.placed = At<Vec3d>(work_, placed);
    view.codes = At<VertexCode>(work_, codes);
    view.triangles = At<uint32_t>(work_, triangles);
    view.item_of = At<uint32_t>(work_, item_of);
    for (int q = 0; q < 3; ++q) view.queue[q] = At<uint32_t>(work_, queue[q]);
    view.queued = At<uint64_t>(work_, queued);
    view.bits = At<uint32_t>(work_, bits);
    view.inside = At<uint32_t>(work_, inside);
    view.columns = At<uint32_t>(work_, columns);
    view.counts = At<BatchCounts>(work_, counts);
    view.packed = At<uint32_t>(work_, packed);
    view.zero = At<uint8_t>(work_, queued);
    view.zero_quads = (packed - queued) / 16;
    packed_offset_ = packed - counts;
    result_bytes_ = layout.bytes() - counts;
    return absl::OkStatus();
  }

  std::span<const std::unique_ptr<Member>> members_;
  BatchState state_;
  std::vector<BatchTargetView> targets_;
  std::vector<uint32_t> first_target_;  // per member, and one more
  uint64_t words_ = 0, columns_ = 0;
  uint64_t packed_offset_ = 0, result_bytes_ = 0;
  DeviceUse use_;  // destroyed behind the arrays, which are freed on its stream
  PinnedBuffer staging_, back_;
  std::vector<PinnedBuffer> staged_;
  std::vector<std::shared_ptr<const CachedArray>> kept_;
  DeviceArray<uint8_t> there_, work_;
};

void RunPass(const Backend& backend, const DeviceInfo& device, std::span<const std::unique_ptr<Member>> members,
             const PlanLimits& limits, BatchStats& stats) {
  for (const auto& member : members) member->item->job->Report("fine_raster", 0);
  const double wall = WallMs(), cpu = CpuMs();
  const uint64_t launches = LaunchesOfThread();
  absl::StatusOr<DeviceUse> use = DeviceUse::Begin(device.ordinal);
  std::optional<Pass> pass;
  absl::Status status = use.status();
  if (use.ok()) status = pass.emplace(device, *std::move(use), members).Run();
  ++stats.passes;
  stats.shared += uint32_t(members.size());
  stats.launches = stats.launches.value_or(0) + LaunchesOfThread() - launches;
  const double wall_ms = WallMs() - wall, cpu_ms = (CpuMs() - cpu) / double(members.size());
  tbb::parallel_for(size_t{0}, members.size(), [&](size_t i) {
    Member& member = *members[i];
    const BatchItem& item = *member.item;
    if (!status.ok() && status.code() != absl::StatusCode::kResourceExhausted) return item.done(status);
    if (!status.ok()) {  // alone it may fit; its plan is told already
      tbb::this_task_arena::isolate(
          [&] { item.done(VoxelizeInside(backend, *item.mesh, *item.request, *item.job, limits, {})); });
      return;
    }
    member.stats.voxelize_ms = wall_ms + member.stats.stages[0].second;
    member.stats.voxelize_cpu_ms = cpu_ms + member.stats.stages[0].second;
    member.stats.stages.emplace_back("fine_raster", wall_ms);
    absl::StatusOr<VoxelizeResult> result = pass->Cut(i);
    item.job->Report("fine_raster", 1);
    item.done(std::move(result));
  });
}

}  // namespace

std::vector<size_t> RunShared(const Backend& backend, const DeviceInfo& device, std::span<const BatchItem> items,
                              const PlanLimits& limits, BatchStats& stats) {
  std::vector<size_t> alone;
  if (items.size() < 2) {
    for (size_t i = 0; i < items.size(); ++i) alone.push_back(i);
    return alone;
  }
  std::vector<std::unique_ptr<Member>> members(items.size());
  tbb::parallel_for(size_t{0}, items.size(), [&](size_t i) {
    tbb::this_task_arena::isolate([&] {
      try {
        members[i] = Prepare(items[i], limits);
      } catch (const std::bad_alloc&) {
        members[i].reset();
      }
    });
  });
  std::vector<std::unique_ptr<Member>> together;
  for (size_t i = 0; i < items.size(); ++i) {
    if (members[i] == nullptr) {
      alone.push_back(i);
      continue;
    }
    if (items[i].on_plan) {
      if (absl::Status refused = items[i].on_plan(members[i]->plan); !refused.ok()) {
        items[i].done(refused);
        continue;
      }
    }
    together.push_back(std::move(members[i]));
  }
  for (size_t begin = 0; begin < together.size();) {
    uint64_t words = 0, triangles = 0, vertices = 0;
    size_t end = begin;
    for (; end < together.size(); ++end) {
      const Member& m = *together[end];
      words += m.words() + m.packed_words() * std::max<uint64_t>(2, m.request().targets.size());
      triangles += m.triangles();
      vertices += m.vertices();
      if (end > begin && (words > kMostWords || triangles > kMostTriangles || vertices > kMostVertices)) break;
    }
    RunPass(backend, device, std::span(together).subspan(begin, end - begin), limits, stats);
    begin = end;
  }
  return alone;
}

}  // namespace voxelpipe::cuda
