#include "cpu/row_bits.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>

#include "cpu/parallel.h"
#include "cpu/row_bins.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kVertexGrain = 1 << 13;
constexpr int64_t kTriangleGrain = 1 << 12;
constexpr int64_t kBoxesAtOnce = 1 << 9;    // stay in the first-level cache
constexpr uint64_t kSlabBytes = 512 << 10;  // of bits: stays in the second-level cache
constexpr int64_t kMaxSlabLayers = 16;

// A run of voxels along x: row (y, z) of the slab as y + ny*(z - first layer).
struct Run {
  uint32_t row;
  uint16_t first, last;  // x, inclusive
};

struct ThreadBins {
  explicit ThreadBins(size_t slabs) : runs(slabs), small(slabs), large(slabs) {}
  Bins<Run> runs;
  Bins<uint32_t> small, large;  // triangle ids
};

int64_t LayersPerSlab(const GridSpec& grid) {
  const uint64_t layer = BitGrid::BytesFor({grid.dims[0], grid.dims[1], 1});
  const int64_t fit = int64_t(std::max<uint64_t>(1, kSlabBytes / layer));
  return std::min(kMaxSlabLayers, int64_t(std::bit_floor(uint64_t(fit))));
}

}  // namespace

bool RowBitsFit(const GridSpec& grid, uint64_t triangles) {
  return std::max({grid.dims[0], grid.dims[1], grid.dims[2]}) <= kMaxCodedDim && triangles < UINT32_MAX;
}

struct RowBits::Impl {
  const RowKernels& kernels;
  const MeshView& mesh;
  const GridSpec grid;
  const Coverage coverage;
  const int64_t layers;  // a slab
  const size_t slabs;
  HostArray<Vec3d> positions;
  HostArray<VertexCode> codes;
  tbb::enumerable_thread_specific<ThreadBins> bins;

  Impl(const RowKernels& k, const MeshView& m, const GridSpec& g, Coverage c)
      : kernels(k),
        mesh(m),
        grid(g),
        coverage(c),
        layers(LayersPerSlab(g)),
        slabs(size_t((g.dims[2] + layers - 1) / layers)),
        bins([this] { return ThreadBins(slabs); }) {}

  absl::Status Place(const JobContext& job) {
    positions = HostArray<Vec3d>(mesh.vertex_count);
    codes = HostArray<VertexCode>(mesh.vertex_count);
    std::atomic<bool> near{true};
    absl::Status s = ParallelChunks(int64_t(mesh.vertex_count), kVertexGrain, job, [&](int64_t begin, int64_t end) {
      if (!kernels.place(mesh.positions, begin, end, grid.origin, grid.voxel_size, positions.data(), codes.data())) {
        near.store(false, std::memory_order_relaxed);
      }
    });
    if (!s.ok() || near) return s;
    for (uint64_t t = 0; t < mesh.triangle_count; ++t) {
      for (const uint32_t v : mesh.triangles[t]) {
        const Vec3d& p = positions[v];
        if (Abs(p.x) <= 0x1p40 && Abs(p.y) <= 0x1p40 && Abs(p.z) <= 0x1p40) continue;
        return absl::OutOfRangeError("a vertex is farther than 2^40 voxels from the grid's origin");
      }
    }
    return s;  // no triangle uses it
  }

  void PushRuns(const TriangleBox& box, Bins<Run>& runs) const {
    const int64_t x0 = std::max<int64_t>(0, box.first[0]), x1 = std::min<int64_t>(grid.dims[0] - 1, box.last[0]);
    const int64_t y0 = std::max<int64_t>(0, box.first[1]), y1 = std::min<int64_t>(grid.dims[1] - 1, box.last[1]);
    const int64_t z0 = std::max<int64_t>(0, box.first[2]), z1 = std::min<int64_t>(grid.dims[2] - 1, box.last[2]);
    for (int64_t z = z0; z <= z1; ++z) {
      const int64_t slab = z / layers;
      for (int64_t y = y0; y <= y1; ++y) {
        runs.Push(size_t(slab), {uint32_t(y + grid.dims[1] * (z - slab * layers)), uint16_t(x0), uint16_t(x1)});
      }
    }
  }

  void BinChunk(int64_t begin, int64_t end, ThreadBins& out) const {
    TriangleBox boxes[kBoxesAtOnce];
    const int64_t dims[3] = {grid.dims[0], grid.dims[1], grid.dims[2]};
    for (int64_t first = begin; first < end; first += kBoxesAtOnce) {
      const int64_t last = std::min(end, first + kBoxesAtOnce);
      kernels.classify(mesh.triangles, codes.data(), first, last, dims, coverage, boxes);
      for (int64_t t = first; t < last; ++t) {
        const TriangleBox& box = boxes[t - first];
        const auto row_class = RowClass(box.row_class);
        if (row_class == RowClass::kOutside) continue;
        if (row_class == RowClass::kRun) {
          PushRuns(box, out.runs);
          continue;
        }
        const int64_t s0 = std::max<int64_t>(0, box.first[2]) / layers;
        const int64_t s1 = std::min<int64_t>(grid.dims[2] - 1, box.last[2]) / layers;
        Bins<uint32_t>& ids = row_class == RowClass::kSmall ? out.small : out.large;
        for (int64_t s = s0; s <= s1; ++s) ids.Push(size_t(s), uint32_t(t));
      }
    }
  }

  // Layers [begin, end) of slab s.
  void RasterSlab(size_t s, const RowSlab& target) const {
    const int64_t words = target.words_per_row * target.ny * (target.end - target.begin);
    std::memset(target.words, 0, size_t(words) * sizeof(uint32_t));
    const RowMesh rows{positions.data(), mesh.triangles};
    const int64_t skipped = target.ny * (target.begin - int64_t(s) * layers);  // rows of the slab before the target
    const int64_t count = target.ny * (target.end - target.begin);
    for (const ThreadBins& bin : bins) {
      bin.runs.ForEachBlock(s, [&](const Run* runs, int64_t n) {
        for (int64_t i = 0; i < n; ++i) {
          const int64_t row = int64_t{runs[i].row} - skipped;
          if (row < 0 || row >= count) continue;
          SetBits(target.words + row * target.words_per_row, runs[i].first, int64_t{runs[i].last} + 1);
        }
      });
      bin.small.ForEachBlock(
          s, [&](const uint32_t* ids, int64_t n) { kernels.raster_small(rows, ids, n, coverage, target); });
      bin.large.ForEachBlock(
          s, [&](const uint32_t* ids, int64_t n) { kernels.raster_large(rows, ids, n, coverage, target); });
    }
  }
};

RowBits::RowBits(const RowKernels& kernels, const MeshView& mesh, const GridSpec& grid, Coverage coverage)
    : impl_(std::make_unique<Impl>(kernels, mesh, grid, coverage)) {}

RowBits::~RowBits() = default;

const Vec3d* RowBits::index_positions() const {
  return impl_->positions.data();
}

absl::Status RowBits::Bin(const JobContext& job) {
  Impl& im = *impl_;
  if (absl::Status s = im.Place(job); !s.ok()) return s;
  return ParallelChunks(int64_t(im.mesh.triangle_count), kTriangleGrain, job,
                        [&](int64_t begin, int64_t end) { im.BinChunk(begin, end, im.bins.local()); });
}

absl::Status RowBits::Raster(int64_t begin, int64_t end, BitGrid& bits, const JobContext& job) const {
  const Impl& im = *impl_;
  const int64_t first = begin / im.layers, last = (end + im.layers - 1) / im.layers;
  return ParallelChunks(last - first, 1, job, [&](int64_t from, int64_t to) {
    for (int64_t s = first + from; s < first + to; ++s) {
      const int64_t z0 = std::max(begin, s * im.layers), z1 = std::min(end, (s + 1) * im.layers);
      im.RasterSlab(size_t(s), {bits.row(im.grid.dims[1] * (z0 - begin)).data(), bits.words_per_row(), im.grid.dims[0],
                                im.grid.dims[1], z0, z1});
    }
  });
}

}  // namespace voxelpipe::cpu
