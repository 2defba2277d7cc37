#include "cpu/dense_fill.h"

#include <algorithm>
#include <bit>

#include "cpu/base/stream.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kBytesBetweenChecks = 4 << 10;

// Where all filled voxels hold the same: whole words are filled at once. `out`: the row's first voxel.
template <typename Element>
void FillAlike(const FillValue& fill, std::span<const uint32_t> inside, std::span<const uint32_t> present,
               uint64_t components, uint64_t plane_step, Element* out) {
  const uint64_t planes = plane_step != 0 ? components : 1, per_voxel = components / planes;
  for (size_t w = 0; w < inside.size(); ++w) {
    const uint32_t mask = inside[w] & ~present[w];
    if (mask == 0) continue;
    for (uint64_t plane = 0; plane < planes; ++plane) {
      Element* const to = out + plane * plane_step + w * 32 * per_voxel;
      if (per_voxel == 1 && mask == ~0u) {
        std::fill_n(to, 32, Element(fill.stored[plane]));
        continue;
      }
      for (uint32_t left = mask; left != 0; left &= left - 1) {
        const auto bit = uint64_t(std::countr_zero(left));
        for (uint64_t c = 0; c < per_voxel; ++c) to[bit * per_voxel + c] = Element(fill.stored[plane + c]);
      }
    }
  }
}

template <typename Element>
void FillElements(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside) {
  auto* const out = reinterpret_cast<Element*>(target.dense.data());
  const bool planar = state.request.request.layout == Layout::kPlanar;
  const uint64_t components = uint64_t(target.spec.components), voxels = state.slab_voxels();
  const std::span<const uint32_t> covered = target.own_presence ? target.presence.row(row) : state.coverage.row(row);
  if (target.part_fills.empty() && target.fill.kind == FillValue::Kind::kStored) {
    const uint64_t first = uint64_t(row) * uint64_t(state.dims[0]);
    FillAlike(target.fill, inside, covered, components, planar ? voxels : 0, out + first * (planar ? 1 : components));
    return;
  }
  const int64_t y = row % state.dims[1], z = row / state.dims[1] + state.slab.begin;
  for (size_t w = 0; w < inside.size(); ++w) {
    for (uint32_t left = inside[w] & ~covered[w]; left != 0; left &= left - 1) {
      const auto x = int64_t(w) * 32 + std::countr_zero(left);
      const uint64_t n = uint64_t(row) * uint64_t(state.dims[0]) + uint64_t(x);
      const FillValue& fill = state.FillOf(target, row, x);
      for (uint64_t c = 0; c < components; ++c) {
        out[planar ? c * voxels + n : n * components + c] = Element(FillStored(fill, x, y, z, int(c)));
      }
    }
  }
}

}  // namespace

void ClearRows(const RunState& state, CpuTarget& target, const VoxelRange& rows, int64_t x_begin, int64_t x_end) {
  const int element_bytes = BitsPerComponent(target.spec.format) / 8, components = target.spec.components;
  const bool planar = state.request.request.layout == Layout::kPlanar;
  const int64_t voxel_bytes = int64_t{element_bytes} * (planar ? 1 : components);
  const int64_t plane_bytes = int64_t(state.slab_voxels()) * element_bytes;
  const ElementPattern clear(target.clear_stored, element_bytes, target.streams());
  // Whole rows are contiguous.
  const bool whole = x_begin == 0 && x_end == state.dims[0];
  const int64_t lines = whole ? 1 : rows.end[1] - rows.begin[1];
  const int64_t line_bytes = (x_end - x_begin) * voxel_bytes * (whole ? rows.end[1] - rows.begin[1] : 1);
  // The layers lie far apart: writing to a fresh page of each may allocate a huge page.
  const bool asks = lines * line_bytes >= kBytesBetweenChecks;
  for (int64_t z = rows.begin[2]; z < rows.end[2]; ++z) {
    if (asks && !state.job.Check().ok()) return;
    for (int64_t line = 0; line < lines; ++line) {
      const int64_t voxel = x_begin + state.dims[0] * state.SlabRow(rows.begin[1] + line, z);
      uint8_t* const to = target.dense.data() + voxel * voxel_bytes;
      for (int plane = 0; plane < (planar ? components : 1); ++plane) clear.Fill(to + plane * plane_bytes, line_bytes);
    }
  }
}

void FillRow(RunState& state, CpuTarget& target, int64_t row, std::span<const uint32_t> inside) {
  switch (BitsPerComponent(target.spec.format)) {
    case 8: return FillElements<uint8_t>(state, target, row, inside);
    case 16: return FillElements<uint16_t>(state, target, row, inside);
    case 32: return FillElements<uint32_t>(state, target, row, inside);
    default: return;
  }
}

}  // namespace voxelpipe::cpu
