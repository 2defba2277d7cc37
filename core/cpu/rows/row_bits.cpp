#include "cpu/rows/row_bits.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

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

// The voxels along each axis, first to last inclusive.
struct VoxelBox {
  int64_t first[3] = {INT16_MAX, INT16_MAX, INT16_MAX}, last[3] = {-1, -1, -1};
};

// The triangles of a slab by part.
class TrianglesOfParts {
 public:
  explicit TrianglesOfParts(const MeshView& mesh) : mesh_(mesh), begin_(mesh.part_count + 1) {}

  // Of the runs that have some; `kind` is the list.
  void Collect(const tbb::enumerable_thread_specific<ThreadWork>& work, size_t slab, BinKind kind) {
    std::fill(begin_.begin(), begin_.end(), 0);
    ForEach(work, slab, kind, [&](uint32_t, uint32_t run) { ++begin_[run + 1]; });
    for (size_t run = 1; run < begin_.size(); ++run) begin_[run] += begin_[run - 1];
    ids_.resize(begin_.back());
    next_.assign(begin_.begin(), begin_.end());
    ForEach(work, slab, kind, [&](uint32_t id, uint32_t run) { ids_[next_[run]++] = id; });
  }
  std::span<const uint32_t> Of(uint32_t run) const {
    return {ids_.data() + begin_[run], size_t(begin_[run + 1] - begin_[run])};
  }

 private:
  template <typename Visit>
  void ForEach(const tbb::enumerable_thread_specific<ThreadWork>& work, size_t slab, BinKind kind,
               const Visit& visit) const {
    uint32_t run = 0;  // triangles of a run mostly follow each other
    uint64_t first = 1, end = 0;
    for (const ThreadWork& thread : work) {
      thread.bins.ForEachBlock(slab * kBinKinds + kind, [&](const uint32_t* ids, int64_t n) {
        for (int64_t i = 0; i < n; ++i) {
          if (ids[i] < first || ids[i] >= end) {
            run = PartOf(mesh_, ids[i]);
            first = mesh_.parts[run].first_triangle;
            end = run + 1 < mesh_.part_count ? mesh_.parts[run + 1].first_triangle : mesh_.triangle_count;
          }
          visit(ids[i], run);
        }
      });
    }
  }

  const MeshView& mesh_;
  std::vector<uint64_t> begin_, next_;  // by run
  std::vector<uint32_t> ids_;
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

  // Calls body(target) for slabs of layers [begin, end) of `bits` that the kernels can address.
  template <typename Body>
  absl::Status ForEachTarget(int64_t begin, int64_t end, BitGrid& bits, const Body& body) const {
    const int64_t ny = grid.dims[1];
    const int64_t most = std::max<int64_t>(1, (kMaxSlabWords - 1) / (ny * bits.words_per_row()));
    for (int64_t z = begin; z < end; z += most) {
      const RowSlab target{
          bits.row(ny * (z - begin)).data(), bits.words_per_row(), grid.dims[0], ny, z, std::min(end, z + most), false};
      if (absl::Status s = body(target); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  // The box of each run of the mesh, within the grid.
  absl::Status FindBoxes(std::vector<VoxelBox>& boxes, const JobContext& job) const {
    boxes.assign(mesh.part_count, {});
    return ParallelChunks(int64_t(mesh.part_count), 1, job, [&](int64_t first, int64_t last) {
      for (int64_t run = first; run < last; ++run) {
        const uint64_t end = run + 1 < mesh.part_count ? mesh.parts[run + 1].first_triangle : mesh.triangle_count;
        VoxelBox& box = boxes[size_t(run)];
        for (uint64_t t = mesh.parts[run].first_triangle; t < end; ++t) {
          for (const uint32_t v : mesh.triangles[t]) {
            for (int a = 0; a < 3; ++a) {
              box.first[a] = std::min<int64_t>(box.first[a], codes[v].axis[a] >> 1);
              box.last[a] = std::max<int64_t>(box.last[a], (codes[v].axis[a] + 1) >> 1);
            }
          }
        }
        for (int a = 0; a < 3; ++a) {
          box.first[a] = std::max<int64_t>(box.first[a], 0);
          box.last[a] = std::min<int64_t>(box.last[a], grid.dims[size_t(a)] - 1);
        }
      }
    });
  }

  // What one thread needs for the parts of a slab.
  struct PartWork {
    PartWork(const MeshView& mesh, int64_t words, size_t parts)
        : kinds{TrianglesOfParts(mesh), TrianglesOfParts(mesh), TrianglesOfParts(mesh)},
          bits(size_t(words)),
          voxels(parts) {}
    TrianglesOfParts kinds[kBinKinds];
    std::vector<uint32_t> bits;  // of one run, all 0 between runs
    std::vector<int64_t> voxels;
  };

  // Moves the bits of a run, in `own`, to the slab, and counts the voxels that it takes. `inside`: of the slab.
  void TakeVoxels(const VoxelBox& box, uint32_t rank, uint32_t* own, const RowSlab& slab, const uint16_t* inside,
                  std::vector<int64_t>& voxels) const {
    for (int64_t z = std::max(box.first[2], slab.begin); z <= std::min(box.last[2], slab.end - 1); ++z) {
      for (int64_t y = box.first[1]; y <= box.last[1]; ++y) {
        const int64_t row = y + slab.ny * (z - slab.begin);
        for (int64_t w = box.first[0] / 32; w <= box.last[0] / 32; ++w) {
          const uint32_t covered = std::exchange(own[row * slab.words_per_row + w], 0);
          if (covered == 0) continue;
          uint32_t& taken = slab.words[row * slab.words_per_row + w];
          for (uint32_t left = covered & ~taken; left != 0; left &= left - 1) {
            const uint16_t around = inside[row * slab.nx + w * 32 + std::countr_zero(left)];
            if (around >= rank) continue;
            ++voxels[rank - 1];
            if (around != 0) --voxels[around - 1];
          }
          taken |= covered;
        }
      }
    }
  }

  // The parts of slab i, by descending rank.
  void RasterPartsOf(const RowMesh& rows, size_t i, const tbb::enumerable_thread_specific<ThreadWork>& work,
                     const RowSlab& slab, const std::vector<VoxelBox>& boxes, const uint16_t* inside,
                     PartWork& memory) const {
    for (const BinKind kind : {kBinRuns, kBinSmall, kBinLarge}) memory.kinds[kind].Collect(work, i, kind);
    RowSlab own = slab;
    own.words = memory.bits.data();
    for (uint32_t run = mesh.part_count; run-- > 0;) {
      const std::span<const uint32_t> boxes_of = memory.kinds[kBinRuns].Of(run),
                                      small = memory.kinds[kBinSmall].Of(run), large = memory.kinds[kBinLarge].Of(run);
      if (boxes_of.empty() && small.empty() && large.empty()) continue;
      for (const uint32_t id : boxes_of) SetRun(id, own);
      kernels.raster_small(rows, small.data(), int64_t(small.size()), coverage, own);
      kernels.raster_large(rows, large.data(), int64_t(large.size()), coverage, own);
      TakeVoxels(boxes[run], mesh.parts[run].rank, own.words, slab, inside, memory.voxels);
    }
  }

  absl::Status RasterParts(const RowSlab& target, const std::vector<VoxelBox>& boxes, const uint16_t* inside,
                           std::vector<int64_t>& voxels, const JobContext& job) const {
    const RowMesh rows = Rows();
    const int64_t layer_words = target.ny * target.words_per_row;
    const auto slabs = size_t((target.end - target.begin + layers - 1) / layers);
    tbb::enumerable_thread_specific<ThreadWork> work([slabs] { return ThreadWork(slabs); });
    RowSlab scanned = target;
    scanned.words = nullptr;
    absl::Status s = ParallelChunks(int64_t(mesh.triangle_count), kTriangleGrain, job, [&](int64_t begin, int64_t end) {
      RasterChunk(rows, begin, end, scanned, work.local());
    });
    if (!s.ok()) return s;
    tbb::enumerable_thread_specific<PartWork> memory(
        [&] { return PartWork(mesh, layer_words * std::min(layers, target.end - target.begin), voxels.size()); });
    s = ParallelChunks(int64_t(slabs), 1, job, [&](int64_t from, int64_t to) {
      for (int64_t i = from; i < to; ++i) {
        RowSlab slab = target;
        slab.words += i * layers * layer_words;
        slab.begin += i * layers;
        slab.end = std::min(target.end, slab.begin + layers);
        std::memset(slab.words, 0, size_t(layer_words * (slab.end - slab.begin)) * sizeof(uint32_t));
        RasterPartsOf(rows, size_t(i), work, slab, boxes, inside + i * layers * target.ny * target.nx, memory.local());
      }
    });
    for (const PartWork& thread : memory) {
      for (size_t rank = 0; rank < voxels.size(); ++rank) voxels[rank] += thread.voxels[rank];
    }
    return s;
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
  return impl_->ForEachTarget(begin, end, bits, [&](const RowSlab& target) { return impl_->Raster(target, job); });
}

absl::Status RowBits::RasterParts(int64_t begin, int64_t end, BitGrid& bits, const uint16_t* inside,
                                  std::vector<int64_t>& voxels, const JobContext& job) const {
  std::vector<VoxelBox> boxes;
  if (absl::Status s = impl_->FindBoxes(boxes, job); !s.ok()) return s;
  return impl_->ForEachTarget(begin, end, bits, [&](const RowSlab& target) {
    const int64_t rows = (target.begin - begin) * target.ny;
    return impl_->RasterParts(target, boxes, inside + rows * target.nx, voxels, job);
  });
}

}  // namespace voxelpipe::cpu
