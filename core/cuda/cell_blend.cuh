// Blending by records of triangles (cell_views.h): a thread a triangle, a warp those of a mesh that lie together.
// No host-only includes.
#pragma once

#include "cuda/cell_walk.cuh"
#include "cuda/span_blend.cuh"

namespace voxelpipe::cuda {

struct BlendCellsArgs {
  const uint64_t *records = nullptr, *blocks = nullptr;
  uint64_t triangles = 0;
  const uint32_t *order = nullptr,
                 *ordered = nullptr;  // of records, and how many there are; null: triangle i has record i
  GridView grid;
  bool in_place = false;  // or else in accumulators
  InPlaceArgs place;      // without spans, as what follows
  AccumulateArgs accumulate;
};

// Takes 32 triangles: one of each lane, t, and its record with the number; `load` makes what it brings.
template <typename T, int kComponents, typename Load, typename Combine, typename Blend>
__device__ inline void BlendRecords(const BlendCellsArgs& args, CellRunRoom<T, kComponents>& room, uint32_t t,
                                    uint64_t number, uint64_t record, Load&& load, Combine&& combine, Blend&& blend) {
  const CellKind kind = KindOfCell(record);
  const uint32_t octants = kind == CellKind::kOctants ? OctantsOfCell(record) : 0;
  T value[kComponents] = {};
  if (kind == CellKind::kBlock || octants != 0) load(t, value);
  CombineRuns<T, kComponents>(room, FirstOfCell(record), octants, value, combine,
                              [&](const OctantOfRun<T, kComponents>& of) {
                                if (of.count == 0) return;
                                blend(BitOfOctant(args.grid, of.first, of.octant), of.value, of.count);
                              });
  if (kind != CellKind::kBlock) return;
  ForEachBlockRow(args.grid, FirstOfCell(record), args.blocks[number], [&](uint32_t at, uint32_t four) {
#pragma unroll
    for (uint32_t x = 0; x < uint32_t(kBlockSide); ++x) {
      if ((four >> x & 1) != 0) blend(at + x, value, 1);
    }
  });
}

// Triangles are taken from the last on, as spans are.
template <int kComponents, int kShader>
__global__ void __launch_bounds__(kBlendThreads) BlendCells(const __grid_constant__ BlendCellsArgs args) {
  constexpr int kWarps = kBlendThreads / 32;
  __shared__ alignas(16) char memory[kWarps * sizeof(CellRunRoom<int64_t, kComponents>)];
  const unsigned warp = threadIdx.x / 32, lane = threadIdx.x % 32;
  auto& cells = reinterpret_cast<CellRunRoom<uint32_t, kComponents>*>(memory)[warp];
  auto& terms = reinterpret_cast<CellRunRoom<int64_t, kComponents>*>(memory)[warp];
  const InPlaceArgs& place = args.place;
  const AccumulateArgs& accumulate = args.accumulate;
  const Kept kept = accumulate.to.kept;
  const bool plain = args.in_place && place.negative != nullptr && *place.negative == 0;
  const uint64_t records = args.ordered == nullptr ? args.triangles : *args.ordered;
  for (uint64_t begin = (uint64_t(blockIdx.x) * kWarps + warp) * 32; begin < records;
       begin += uint64_t(gridDim.x) * kBlendThreads) {
    const bool takes = begin + lane < records;
    const uint64_t number = takes ? records - 1 - begin - lane : 0;
    const uint32_t t = args.ordered == nullptr || !takes ? uint32_t(number) : args.order[number];
    const uint64_t record = takes ? args.records[number] : 0;
    if (args.in_place) {
      BlendRecords<uint32_t, kComponents>(
          args, cells, t, number, record,
          [&](uint32_t of, uint32_t(&value)[kComponents]) { KeysOf<kShader, kComponents>(place, plain, of, value); },
          [&](uint32_t a, uint32_t b) { return CombineKeys(place, a, b); },
          [&](uint32_t at, const uint32_t(&value)[kComponents], uint32_t count) {
            BlendAt<kComponents>(place, VoxelOfBit(at, place.nx, place.words_per_row), value, count);
          });
    } else if (kept == Kept::kSum || kept == Kept::kAverage) {
      BlendRecords<int64_t, kComponents>(
          args, terms, t, number, record,
          [&](uint32_t of, int64_t(&value)[kComponents]) { TermsOf<kShader, kComponents>(accumulate, of, value); },
          AddTerms,
          [&](uint32_t at, const int64_t(&value)[kComponents], uint32_t count) {
            AddAt<kComponents>(accumulate.to, accumulate.ranks.Of(at / 32, at % 32), value, count);
          });
    } else {
      BlendRecords<uint32_t, kComponents>(
          args, cells, t, number, record,
          [&](uint32_t of, uint32_t(&value)[kComponents]) {
            if (kept != Kept::kCount) ValuesOf<kShader, kComponents>(accumulate.values, accumulate.shading, of, value);
          },
          [&](uint32_t a, uint32_t b) { return CombineCells(kept, a, b); },
          [&](uint32_t at, const uint32_t(&value)[kComponents], uint32_t count) {
            AddAt<kComponents>(accumulate.to, accumulate.ranks.Of(at / 32, at % 32), value, count);
          });
    }
  }
}

}  // namespace voxelpipe::cuda
