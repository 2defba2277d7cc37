// Blends the coverage records of triangles (coverage_record.h): one thread per triangle; a warp takes neighbours of the
// mesh. No host-only includes.
#pragma once

#include "cuda/coverage/coverage_pass.cuh"
#include "cuda/scatter/blend_spans.cuh"

namespace voxelpipe::cuda {

struct BlendCellsArgs {
  const uint64_t *records = nullptr, *blocks = nullptr;
  uint64_t triangles = 0;
  const PackedVertex* placed = nullptr;  // triangles in the order of records; null: by id
  GridView grid;
  // BlendTo selects one of the two. Their spans are not set.
  InPlaceArgs place;
  AccumulateArgs accumulate;
};

// Calls visit(destination) for each voxel of a block; all of them are covered. Voxels of a row within a word of the
// coverage have consecutive destinations (ranks or target cells), so one lookup serves all.
template <typename PlaceOf, typename Visit>
__device__ inline void ForEachPlace(const GridView& grid, uint32_t block, uint64_t mask, PlaceOf&& place_of,
                                    Visit&& visit) {
  ForEachBlockRow(grid, block, mask, [&](uint32_t at, uint32_t four) {
    const uint32_t first = at + uint32_t(__ffs(int(four))) - 1, end = first + uint32_t(__popc(four));
    uint64_t place = 0;
    for (uint32_t bit = first; bit < end; ++bit, ++place) {
      if (bit == first || bit % 32 == 0) place = place_of(bit);
      visit(place);
    }
  });
}

// Shared memory of a warp for four sums per lane, padded against bank conflicts.
struct alignas(16) FourSumsRoom {
  int64_t terms[32 + 32 / 4][4];
  __device__ int64_t (&Of(unsigned lane))[4] { return terms[lane + lane / 4]; }
};

// AddAt for four sums per voxel; `count` is 0 for inactive lanes. Four lanes add the sums of one voxel together: they
// lie in one sector, and the cache serializes atomic operations on a sector. All 32 lanes call it.
__device__ inline void AddFourSums(FourSumsRoom& room, const Accumulators& to, uint32_t rank, const int64_t (&term)[4],
                                   uint32_t count) {
  const unsigned lane = threadIdx.x % 32, first = lane & ~3u, mine = lane & 3;
  if (to.kept == Kept::kAverage && count > 0) atomicAdd(to.counts + rank, count);
  __syncwarp();  // the shared memory is free
#pragma unroll
  for (int c = 0; c < 4; ++c) room.Of(lane)[c] = term[c];
  __syncwarp();
#pragma unroll
  for (unsigned k = 0; k < 4; ++k) {
    const bool has = __shfl_sync(~0u, count, int(first + k)) > 0;
    const uint64_t at = uint64_t{__shfl_sync(~0u, rank, int(first + k))} * 4 + mine;
    if (has) atomicAdd(to.sums + at, static_cast<unsigned long long>(room.Of(first + k)[mine]));
  }
}

// Processes 32 triangles, one per lane: triangle t and record `record` with index `number`. `load` computes its value,
// `emit` receives the results of CombineRuns, `place_of` maps a bit index to a destination, and blend(destination,
// value, number of triangles) blends blocks.
template <typename T, int kComponents, typename Load, typename Combine, typename Emit, typename PlaceOf, typename Blend>
__device__ inline void BlendRecords(const BlendCellsArgs& args, CellRunRoom<T, kComponents>& room, uint32_t t,
                                    uint64_t number, uint64_t record, Load&& load, Combine&& combine, Emit&& emit,
                                    PlaceOf&& place_of, Blend&& blend) {
  const CellKind kind = KindOfCell(record);
  const uint32_t octants = kind == CellKind::kOctants ? OctantsOfCell(record) : 0;
  T value[kComponents] = {};
  if (kind == CellKind::kBlock || octants != 0) load(t, value);
  CombineRuns<T, kComponents>(room, FirstOfCell(record), octants, value, combine, emit);
  if (kind != CellKind::kBlock) return;
  ForEachPlace(args.grid, FirstOfCell(record), args.blocks[number], place_of,
               [&](uint64_t place) { blend(place, value, 1); });
}

// The destination: the dense target or accumulators.
enum class BlendTo { kTarget, kAccumulators };

// Processes triangles in descending order, like spans.
template <int kComponents, int kShader, BlendTo kTo>
__global__ void __launch_bounds__(kBlendThreads) BlendCells(const __grid_constant__ BlendCellsArgs args) {
  constexpr int kWarps = kBlendThreads / 32;
  constexpr size_t kCells = sizeof(CellRunRoom<uint32_t, kComponents>),
                   kTerms = sizeof(CellRunRoom<int64_t, kComponents>);
  __shared__ alignas(16) char memory[kWarps * (kTo == BlendTo::kTarget ? kCells : kTerms)];
  constexpr bool kFourSums = kTo != BlendTo::kTarget && kComponents == 4;
  __shared__ FourSumsRoom four_sums[kFourSums ? kWarps : 1];
  const unsigned warp = threadIdx.x / 32, lane = threadIdx.x % 32;
  auto& cells = reinterpret_cast<CellRunRoom<uint32_t, kComponents>*>(memory)[warp];
  auto& terms = reinterpret_cast<CellRunRoom<int64_t, kComponents>*>(memory)[warp];
  const InPlaceArgs& place = args.place;
  const AccumulateArgs& accumulate = args.accumulate;
  const Kept kept = accumulate.to.kept;
  const bool plain = kTo == BlendTo::kTarget && place.negative != nullptr && *place.negative == 0;
  const uint64_t records = args.triangles;
  const auto place_of = [&](uint32_t bit) {
    if constexpr (kTo == BlendTo::kTarget) {
      return VoxelOfBit(bit, place.nx, place.words_per_row);
    } else {
      return uint64_t{accumulate.ranks.Of(bit / 32, bit % 32)};
    }
  };
  const auto place_of_octant = [&](const auto& of) { return place_of(BitOfOctant(args.grid, of.first, of.octant)); };
  const auto add = [&](uint64_t at, const auto& value, uint32_t count) {
    AddAt<kComponents>(accumulate.to, at, value, count);
  };
  const auto add_octant = [&](const auto& of) {
    if (of.count > 0) add(place_of_octant(of), of.value, of.count);
  };
  const auto add_sums = [&](const OctantOfRun<int64_t, kComponents>& of) {
    if constexpr (kFourSums) {
      const auto rank = uint32_t(of.count > 0 ? place_of_octant(of) : 0);
      AddFourSums(four_sums[warp], accumulate.to, rank, of.value, of.count);
    } else {
      add_octant(of);
    }
  };
  const auto blend_octant = [&](const OctantOfRun<uint32_t, kComponents>& of) {
    if (of.count > 0) BlendAt<kComponents>(place, place_of_octant(of), of.value, of.count);
  };
  for (uint64_t begin = (uint64_t(blockIdx.x) * kWarps + warp) * 32; begin < records;
       begin += uint64_t(gridDim.x) * kBlendThreads) {
    const bool takes = begin + lane < records;
    const uint64_t number = takes ? records - 1 - begin - lane : 0;
    const uint64_t record = takes ? args.records[number] : 0;
    const uint32_t t = args.placed != nullptr && takes ? args.placed[3 * number].triangle : uint32_t(number);
    if constexpr (kTo == BlendTo::kTarget) {
      BlendRecords<uint32_t, kComponents>(
          args, cells, t, number, record,
          [&](uint32_t of, uint32_t(&value)[kComponents]) { KeysOf<kShader, kComponents>(place, plain, of, value); },
          [&](uint32_t a, uint32_t b) { return CombineKeys(place, a, b); }, blend_octant, place_of,
          [&](uint64_t at, const uint32_t(&value)[kComponents], uint32_t count) {
            BlendAt<kComponents>(place, at, value, count);
          });
    } else if (kept == Kept::kSum || kept == Kept::kAverage) {
      BlendRecords<int64_t, kComponents>(
          args, terms, t, number, record,
          [&](uint32_t of, int64_t(&value)[kComponents]) { TermsOf<kShader, kComponents>(accumulate, of, value); },
          AddTerms, add_sums, place_of, add);
    } else {
      BlendRecords<uint32_t, kComponents>(
          args, cells, t, number, record,
          [&](uint32_t of, uint32_t(&value)[kComponents]) {
            if (kept != Kept::kCount) ValuesOf<kShader, kComponents>(accumulate.values, accumulate.shading, of, value);
          },
          [&](uint32_t a, uint32_t b) { return CombineCells(kept, a, b); }, add_octant, place_of, add);
    }
  }
}

}  // namespace voxelpipe::cuda
