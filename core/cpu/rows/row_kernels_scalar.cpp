// The kernels in plain C++, which the vector kernels repeat lane by lane, and the choice among all.
#include <hwy/targets.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "cpu/rows/row_kernels_simd.h"
#include "cpu/rows/tile_spans.h"
#include "grid/index_space.h"

namespace voxelpipe::cpu {

void AddTileSpans(const TriangleSetup& setup, const VoxelRange& tile, int triangle, TileSpans& out) {
  ForEachRowSpan(setup, tile, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
    out.Add(triangle, (y - tile.begin[1]) + TileDim(1) * (z - tile.begin[2]), x_begin - tile.begin[0],
            x_end - 1 - tile.begin[0]);
  });
}

namespace {

constexpr double kMaxDistance = 0x1p40;  // voxels

int16_t Code(double p) {
  const double first = setup_internal::FirstVoxel(p, 0.5, kNarrowWidening);
  const double last = setup_internal::LastVoxel(p, 0.5, kNarrowWidening);
  return int16_t(Clamp(first + last, -32768.0, 32767.0));  // last - first is 0 or 1
}

Placed Place(const Vec3d* world, int64_t begin, int64_t end, const IndexSpace& space, Vec3d* index, VertexCode* codes) {
  bool near = true;
  for (int64_t i = begin; i < end; ++i) {
    const Vec3d p = WorldToIndex(space, world[i]);
    if (index != nullptr) index[i] = p;
    near = near && Abs(p.x) <= kMaxDistance && Abs(p.y) <= kMaxDistance && Abs(p.z) <= kMaxDistance;
    codes[i] = {{Code(p.x), Code(p.y), Code(p.z), 0}};
  }
  return {near, true};
}

void Scan(const RowMesh& mesh, int64_t begin, int64_t end, Coverage coverage, const RowSlab& slab, RowLists& lists) {
  const int64_t least[3] = {0, 0, slab.begin}, most[3] = {slab.nx - 1, slab.ny - 1, slab.end - 1};
  for (int64_t t = begin; t < end; ++t) {
    const uint32_t* v = mesh.triangles[t];
    const int16_t *a = mesh.codes[v[0]].axis, *b = mesh.codes[v[1]].axis, *c = mesh.codes[v[2]].axis;
    int64_t first[3], last[3];
    bool outside = false;
    int single = 0;
    for (int i = 0; i < 3; ++i) {
      first[i] = Min(a[i], Min(b[i], c[i])) >> 1;
      last[i] = (Max(a[i], Max(b[i], c[i])) + 1) >> 1;
      outside = outside || last[i] < least[i] || first[i] > most[i];
      single += first[i] == last[i];
    }
    if (outside) continue;
    const bool run = coverage == Coverage::kConservative && single >= 2;
    if (run && slab.words != nullptr) {
      SetBox(slab, first, last);
      continue;
    }
    const int64_t rows = last[1] - first[1] + 1, layers = last[2] - first[2] + 1;
    if (run) {
      lists.run[lists.runs++] = uint32_t(t);
    } else if (rows <= kSmallRows && layers <= kSmallRows) {
      lists.AddSmall(uint32_t(t), uint32_t(rows - 1 + kSmallRows * (layers - 1)));
    } else {
      lists.large[lists.larges++] = uint32_t(t);
    }
  }
}

void Raster(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab) {
  const VoxelRange range{{0, 0, slab.begin}, {slab.nx, slab.ny, slab.end}};
  const auto at = [&](uint32_t v) { return WorldToIndex(mesh.space, mesh.positions[v]); };
  for (int64_t i = 0; i < count; ++i) {
    const uint32_t* v = mesh.triangles[ids[i]];
    const TriangleSetup setup = SetUpTriangle(at(v[0]), at(v[1]), at(v[2]), coverage);
    ForEachRowSpan(setup, range, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
      SetBits(slab.words + (y + slab.ny * (z - slab.begin)) * slab.words_per_row, x_begin, x_end, slab.shared);
    });
  }
}

void TileBoxes(const uint32_t (*triangles)[3], const VertexCode* codes, int64_t begin, int64_t end,
               const int64_t (&dims)[3], TileBox* boxes) {
  for (int64_t t = begin; t < end; ++t) {
    const int16_t *a = codes[triangles[t][0]].axis, *b = codes[triangles[t][1]].axis, *c = codes[triangles[t][2]].axis;
    TileBox& box = boxes[t - begin];
    bool large = false, outside = false;
    for (int i = 0; i < 3; ++i) {
      const int64_t first = Min(a[i], Min(b[i], c[i])) >> 1, last = (Max(a[i], Max(b[i], c[i])) + 1) >> 1;
      large = large || last - first > TileBox::kMaxExtent;
      outside = outside || last < 0 || first >= dims[i];
      box.first[i] = int16_t(Max(first, int64_t{0}) / TileDim(i));
      box.last[i] = int16_t(Min(last, dims[i] - 1) / TileDim(i));
    }
    box.kind = large ? TileBox::kLarge : outside ? TileBox::kOutside : TileBox::kBoxed;
    box.unused = 0;
  }
}

void SpansInTile(const RowMesh& mesh, const uint64_t* pairs, int64_t count, Coverage coverage, const VoxelRange& tile,
                 TileSpans& out) {
  for (int i = 0; i < int(count); ++i) {
    const uint32_t* v = mesh.triangles[uint32_t(pairs[i])];
    out.count[i] = 0;
    AddTileSpans(SetUpTriangle(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], coverage), tile, i,
                 out);
  }
}

void CrossSmall(const RowMesh& mesh, int64_t begin, int64_t end, const LineBlocks& lines, Crossings& out) {
  for (int64_t t = begin; t < end; ++t) {
    const uint32_t* v = mesh.triangles[t];
    const Vec3d &a = mesh.positions[v[0]], &b = mesh.positions[v[1]], &c = mesh.positions[v[2]];
    const LineRange range = LinesOf(a, b, c, lines);
    if (range.empty()) continue;
    if (range.y_end - range.y_begin > Crossings::kSmallRows || range.z_end - range.z_begin > Crossings::kSmallRows) {
      out.large[out.larges++] = uint32_t(t);
      continue;
    }
    ForEachCrossing(a, b, c, range, lines.nx,
                    [&](int64_t y, int64_t z, int64_t before, bool falls) { out.Add(lines, y, z, before, falls); });
  }
}

void CrossLarge(const RowMesh& mesh, uint32_t id, const LineBlocks& lines, int64_t block, const BlockToggles& out) {
  const uint32_t* v = mesh.triangles[id];
  CrossLargePlain(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], lines, block, out);
}

int64_t SpreadToggles(const BlockToggles& in, int64_t rows, int64_t words_per_row, uint32_t* out, bool add) {
  int64_t odd = 0;
  for (int64_t r = 0; r < rows; ++r) {
    uint32_t carry = 0;
    for (int64_t w = (r + 1) * words_per_row; w-- > r * words_per_row;) {
      uint32_t bits = in.words[w];
      for (int shift = 1; shift < 32; shift *= 2) bits ^= bits >> shift;
      bits ^= carry;
      carry = (bits & 1) != 0 ? ~0u : 0;
      out[w] = add ? out[w] | bits : bits;
    }
    odd += (carry & 1) != (in.outside[r / 32] >> (r % 32) & 1);
  }
  return odd;
}

const RowKernels kScalar{"scalar",  Place,       Scan,       Raster,     Raster,
                         TileBoxes, SpansInTile, CrossSmall, CrossLarge, SpreadToggles};

}  // namespace

void RowLists::SortSmall() {
  constexpr int kShapes = kSmallRows * kSmallRows,
                kWays = 4;  // neighbours often have equal shapes: increments of one counter would depend on each other
  uint32_t next[kShapes][kWays] = {};
  for (int64_t i = 0; i < smalls; ++i) ++next[shape[i]][i % kWays];
  uint32_t before = 0;
  for (auto& counts : next) {
    for (uint32_t& count : counts) before += std::exchange(count, before);
  }
  for (int64_t i = 0; i < smalls; ++i) sorted[next[shape[i]][i % kWays]++] = small[i];
}

absl::StatusOr<const RowKernels*> SelectRowKernels(SimdChoice choice) {
  static const int64_t supported = hwy::SupportedTargets();  // CPUID, which is slow in a virtual machine
  const auto has = [](int64_t target) { return (supported & target) != 0; };
  const bool avx512 = has(HWY_AVX3) && Avx512RowKernels() != nullptr;
  const bool avx2 = has(HWY_AVX2) && Avx2RowKernels() != nullptr;
  switch (choice) {
    case SimdChoice::kAuto: return avx512 ? Avx512RowKernels() : avx2 ? Avx2RowKernels() : &kScalar;
    case SimdChoice::kScalar: return &kScalar;
    case SimdChoice::kAvx2:
      if (avx2) return Avx2RowKernels();
      break;
    case SimdChoice::kAvx512:
      if (avx512) return Avx512RowKernels();
      break;
  }
  return absl::FailedPreconditionError(
      absl::StrCat("simd: this machine has no ", std::string(Name(choice)), "; auto takes what it has"));
}

}  // namespace voxelpipe::cpu
