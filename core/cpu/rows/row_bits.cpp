#include "cpu/rows/row_bits.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>

#include "base/parallel.h"
#include "cpu/base/task_sizes.h"
#include "cpu/rows/row_bins.h"
#include "grid/index_space.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kVertexGrain = 1 << 13;
constexpr int64_t kClearBytes = 1 << 20;
constexpr uint64_t kSlabBytes = 512 << 10;  // of bits: stays in the L2 cache
// Bits are set in the grid itself if it fits in the L2 cache, or if there are so many triangles that neighbours find
// its words cached; otherwise triangles are binned to slabs first. Measured.
constexpr int64_t kCachedWords = 1 << 18;
constexpr int64_t kWordsPerTriangle = 64;

int64_t LayersPerSlab(const GridSpec& grid) {
  const uint64_t layer = BitGrid::BytesFor({grid.dims[0], grid.dims[1], 1});
  const int64_t fit = int64_t(std::max<uint64_t>(1, kSlabBytes / layer));
  return std::min(kMaxSlabLayers, int64_t(std::bit_floor(uint64_t(fit))));
}

// Lists of a slab.
enum BinKind { kBinRuns, kBinSmall, kBinLarge, kBinKinds };

// The lists of one thread.
struct ThreadWork {
  explicit ThreadWork(size_t slabs) : bins(slabs * kBinKinds) {}
  RowLists lists;
  Bins<uint32_t> bins;  // triangle ids: list kind + kBinKinds * slab
};

}  // namespace

struct RowBits::Impl {
  const RowKernels& kernels;
  const MeshView& mesh;
  const GridSpec grid;
  const IndexSpace space;
  const Coverage coverage;
  const int64_t layers;  // a slab
  HostArray<Vec3d> positions;
  HostArray<VertexCode> codes;
  bool regular = true;

  Impl(const RowKernels& k, const MeshView& m, const GridSpec& g, Coverage c)
      : kernels(k), mesh(m), grid(g), space(g.index_space()), coverage(c), layers(LayersPerSlab(g)) {}

  RowMesh Rows() const { return {mesh.positions, codes.data(), mesh.triangles, space, regular}; }

  absl::Status Place(bool keep_positions, const JobContext& job) {
    if (keep_positions) positions = HostArray<Vec3d>(mesh.vertex_count);
    codes = HostArray<VertexCode>(mesh.vertex_count);
    Vec3d* const index = keep_positions ? positions.data() : nullptr;
    std::atomic<bool> all_near{true}, all_regular{true};
    absl::Status s = ParallelChunks(int64_t(mesh.vertex_count), kVertexGrain, job, [&](int64_t begin, int64_t end) {
      const Placed placed = kernels.place(mesh.positions, begin, end, space, index, codes.data());
      if (!placed.near) all_near.store(false, std::memory_order_relaxed);
      if (!placed.regular) all_regular.store(false, std::memory_order_relaxed);
    });
    regular = all_regular;
    if (!s.ok() || all_near) return s;
    for (uint64_t t = 0; t < mesh.triangle_count; ++t) {
      for (const uint32_t v : mesh.triangles[t]) {
        const Vec3d p = WorldToIndex(space, mesh.positions[v]);
        if (Abs(p.x) <= 0x1p40 && Abs(p.y) <= 0x1p40 && Abs(p.z) <= 0x1p40) continue;
        return absl::OutOfRangeError("a vertex is farther than 2^40 voxels from the grid's origin");
      }
    }
    return s;  // no triangle uses it
  }

  // Triangles by slabs of layers, counted from the target's first.
  void BinTriangles(const uint32_t* ids, int64_t count, BinKind kind, const RowSlab& target, ThreadWork& work) const {
    for (int64_t i = 0; i < count; ++i) {
      const uint32_t* v = mesh.triangles[ids[i]];
      const int16_t a = codes[v[0]].axis[2], b = codes[v[1]].axis[2], c = codes[v[2]].axis[2];
      const int64_t first = std::max<int64_t>(Min(a, Min(b, c)) >> 1, target.begin);
      const int64_t last = std::min<int64_t>((Max(a, Max(b, c)) + 1) >> 1, target.end - 1);
      for (int64_t s = (first - target.begin) / layers; s <= (last - target.begin) / layers; ++s) {
        work.bins.Push(size_t(s) * kBinKinds + kind, ids[i]);
      }
    }
  }

  // Rasterizes small triangles into the grid, and bins the others.
  void RasterChunk(const RowMesh& rows, int64_t begin, int64_t end, const RowSlab& target, ThreadWork& work) const {
    RowLists& lists = work.lists;
    for (int64_t first = begin; first < end; first += RowLists::kMaxTriangles) {
      lists.Clear();
      kernels.scan(rows, first, std::min(end, first + RowLists::kMaxTriangles), coverage, target, lists);
      lists.SortSmall();
      if (target.words != nullptr) {
        kernels.raster_small(rows, lists.sorted, lists.smalls, coverage, target);
      } else {
        BinTriangles(lists.sorted, lists.smalls, kBinSmall, target, work);
      }
      BinTriangles(lists.large, lists.larges, kBinLarge, target, work);
      BinTriangles(lists.run, lists.runs, kBinRuns, target, work);
    }
  }

  void SetRun(uint32_t triangle, const RowSlab& slab) const {
    const uint32_t* v = mesh.triangles[triangle];
    int64_t first[3], last[3];
    for (int i = 0; i < 3; ++i) {
      const int16_t a = codes[v[0]].axis[i], b = codes[v[1]].axis[i], c = codes[v[2]].axis[i];
      first[i] = Min(a, Min(b, c)) >> 1;
      last[i] = (Max(a, Max(b, c)) + 1) >> 1;
    }
    SetBox(slab, first, last);
  }

  // Rasterizes the triangles of slab i.
  void RasterBins(const RowMesh& rows, size_t i, const ThreadWork& work, const RowSlab& slab) const {
    work.bins.ForEachBlock(i * kBinKinds + kBinRuns, [&](const uint32_t* ids, int64_t n) {
      for (int64_t k = 0; k < n; ++k) SetRun(ids[k], slab);
    });
    work.bins.ForEachBlock(i * kBinKinds + kBinSmall,
                           [&](const uint32_t* ids, int64_t n) { kernels.raster_small(rows, ids, n, coverage, slab); });
    work.bins.ForEachBlock(i * kBinKinds + kBinLarge,
                           [&](const uint32_t* ids, int64_t n) { kernels.raster_large(rows, ids, n, coverage, slab); });
  }

  absl::Status Clear(const RowSlab& target, const JobContext& job) const {
    const int64_t bytes = target.words_per_row * target.ny * (target.end - target.begin) * int64_t(sizeof(uint32_t));
    return ParallelChunks((bytes + kClearBytes - 1) / kClearBytes, 1, job, [&](int64_t begin, int64_t end) {
      std::memset(reinterpret_cast<uint8_t*>(target.words) + begin * kClearBytes, 0,
                  size_t(std::min(bytes, end * kClearBytes) - begin * kClearBytes));
    });
  }

  absl::Status Raster(const RowSlab& target, const JobContext& job) const {
    if (coverage == Coverage::kNone) return Clear(target, job);
    const RowMesh rows = Rows();
    const int64_t layer_words = target.ny * target.words_per_row;
    const int64_t words = layer_words * (target.end - target.begin);
    const auto slabs = size_t((target.end - target.begin + layers - 1) / layers);
    const bool in_place = words <= std::max(kCachedWords, kWordsPerTriangle * int64_t(mesh.triangle_count));
    tbb::enumerable_thread_specific<ThreadWork> work([slabs] { return ThreadWork(slabs); });
    RowSlab direct = target;
    direct.shared = tbb::this_task_arena::max_concurrency() > 1;
    if (!in_place) {
      direct.words = nullptr;
    } else if (absl::Status s = Clear(target, job); !s.ok()) {
      return s;
    }
    absl::Status s = ParallelChunks(int64_t(mesh.triangle_count), kTriangleGrain, job, [&](int64_t begin, int64_t end) {
      RasterChunk(rows, begin, end, direct, work.local());
    });
    if (!s.ok()) return s;
    // One thread works on a slab, which stays in its cache.
    return ParallelChunks(int64_t(slabs), 1, job, [&](int64_t from, int64_t to) {
      for (int64_t i = from; i < to; ++i) {
        RowSlab slab = target;
        slab.words += i * layers * layer_words;
        slab.begin += i * layers;
        slab.end = std::min(target.end, slab.begin + layers);
        if (!in_place) std::memset(slab.words, 0, size_t(layer_words * (slab.end - slab.begin)) * sizeof(uint32_t));
        for (const ThreadWork& thread : work) RasterBins(rows, size_t(i), thread, slab);
      }
    });
  }
};

RowBits::RowBits(const RowKernels& kernels, const MeshView& mesh, const GridSpec& grid, Coverage coverage)
    : impl_(std::make_unique<Impl>(kernels, mesh, grid, coverage)) {}

RowBits::~RowBits() = default;

const Vec3d* RowBits::index_positions() const {
  return impl_->positions.empty() ? nullptr : impl_->positions.data();
}

absl::Status RowBits::Place(bool keep_positions, const JobContext& job) {
  return impl_->Place(keep_positions, job);
}

absl::Status RowBits::Raster(int64_t begin, int64_t end, BitGrid& bits, const JobContext& job) const {
  const int64_t ny = impl_->grid.dims[1],
                most = std::max<int64_t>(1, (kMaxSlabWords - 1) / (ny * bits.words_per_row()));
  for (int64_t z = begin; z < end; z += most) {
    const RowSlab target{bits.row(ny * (z - begin)).data(),
                         bits.words_per_row(),
                         impl_->grid.dims[0],
                         ny,
                         z,
                         std::min(end, z + most),
                         false};
    if (absl::Status s = impl_->Raster(target, job); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cpu
