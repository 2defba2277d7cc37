// Parity fill: one toggled bit a crossing, then a suffix exclusive-or along each row.
//
// Source: the fill of M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010, section 5.
// Changed: crossings are counted per edge as DESIGN section 3 defines, so that closed meshes leave no streaks; a single bit is
// toggled and spread at the end.
#include <atomic>
#include <bit>

#include "cpu/dense_fill.h"
#include "cpu/flood_fill.h"
#include "cpu/parallel.h"
#include "cpu/run_state.h"
#include "raster/crossing.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kTriangleGrain = 1 << 12;

// Toggling commutes, so the order of threads does not matter.
void Toggle(uint32_t& word, uint32_t mask) {
  std::atomic_ref<uint32_t>(word).fetch_xor(mask, std::memory_order_relaxed);
}

// The j (or k) of [first, last) whose centre may lie within [lo, hi] of one axis of the triangle.
void CentreRange(double lo, double hi, int64_t first, int64_t last, int64_t& begin, int64_t& end) {
  begin = int64_t(Clamp(floor(lo - 0.5), double(first), double(last)));
  end = int64_t(Clamp(ceil(hi - 0.5) + 1, double(first), double(last)));
}

// `columns` holds one bit a column (j, k): the parity of all its crossings.
void ToggleTriangle(RunState& state, BitGrid& columns, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  int64_t y_begin, y_end, z_begin, z_end;
  CentreRange(Min(a.y, Min(b.y, c.y)), Max(a.y, Max(b.y, c.y)), 0, state.dims[1], y_begin, y_end);
  CentreRange(Min(a.z, Min(b.z, c.z)), Max(a.z, Max(b.z, c.z)), state.slab.begin, state.slab.end, z_begin, z_end);
  if (y_begin >= y_end || z_begin >= z_end) return;
  TrianglePlane plane;
  bool set_up = false;  // most triangles of a fine mesh cross no line
  for (int64_t z = z_begin; z < z_end; ++z) {
    for (int64_t y = y_begin; y < y_end; ++y) {
      const double py = double(y) + 0.5, pz = double(z) + 0.5;
      if (!LineCrosses(a, b, c, py, pz)) continue;
      if (!set_up) plane = SetUpPlane(a, b, c);
      set_up = true;
      Toggle(columns.row(z - state.slab.begin)[y / 32], 1u << (y % 32));
      const int64_t before = CentresBefore(CrossingX(plane, a, b, c, py, pz), state.dims[0]);
      if (before == 0) continue;
      Toggle(state.inside.row(state.SlabRow(y, z))[(before - 1) / 32], 1u << ((before - 1) % 32));
    }
  }
}

// Bit i becomes the parity of the toggles at i and beyond.
void SuffixXor(std::span<uint32_t> row) {
  uint32_t carry = 0;
  for (size_t w = row.size(); w-- > 0;) {
    uint32_t bits = row[w];
    for (int shift = 1; shift < 32; shift *= 2) bits ^= bits >> shift;
    row[w] = bits ^ carry;
    carry = row[w] & 1 ? ~0u : 0;
  }
}

absl::Status ParityInside(RunState& state) {
  auto columns = BitGrid::Create({state.dims[1], state.slab.depth(), 1});
  if (!columns.ok()) return columns.status();
  absl::Status s =
      ParallelChunks(int64_t(state.view.triangle_count), kTriangleGrain, state.job, [&](int64_t begin, int64_t end) {
        for (int64_t t = begin; t < end; ++t) {
          const uint32_t* v = state.view.triangles[t];
          ToggleTriangle(state, *columns, state.index_positions[v[0]], state.index_positions[v[1]],
                         state.index_positions[v[2]]);
        }
      });
  if (!s.ok()) return s;
  state.counts.odd_columns = CountBits(*columns);
  return ParallelChunks(state.inside.rows(), 256, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) SuffixXor(state.inside.row(r));
  });
}

}  // namespace

absl::Status SolidFill(RunState& state) {
  auto inside = BitGrid::Create(state.slab_dims);
  if (!inside.ok()) return inside.status();
  state.inside = *std::move(inside);
  absl::Status s = state.request.request.fill == Fill::kFlood ? FloodInside(state) : ParityInside(state);
  if (!s.ok()) return s;
  if (state.request.request.result == ResultKind::kSparse)
    return absl::OkStatus();  // the bricks are filled as they are made
  return ParallelChunks(state.inside.rows(), 256, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      for (CpuTarget& target : state.targets) {
        if (target.spec.format != VoxelFormat::kBit) FillRow(state, target, r, state.inside.row(r));
      }
    }
  });
}

}  // namespace voxelpipe::cpu
