// Dense largest and least values of scattered triangles: every cell is written once, with what the largest triangles bring, as keys
// (span_blend.cuh), and so is the coverage. All other triangles are blended over that. So the largest take no more of memory than clearing
// does, where spans of theirs would each fetch cells from outside the cache.
// No host-only includes.
#pragma once

#include "cuda/in_place.cuh"
#include "cuda/row_parts.cuh"
#include "cuda/span_runs.cuh"

namespace voxelpipe::cuda {

struct FillRowArgs {
  InPlaceArgs place;              // a target of one component, in rows of whole words, whose cells begin from 0
  bool by_id = false;             // triangles bring their number
  BitArgs walk;                   // its `largest` are drawn here
  uint32_t* taken = nullptr;      // groups of rows that blocks have taken: 0
  uint32_t* coverage = nullptr;   // written too; null: another launch sees to it
  uint64_t* fragments = nullptr;  // likewise, kFragmentSlots counters
};

// Of a warp. Between two parts of rows all cells are 0.
struct FillPart {
  alignas(16) uint32_t cells[kRowCells];
  uint32_t covered[kRowCells / 32];
};

inline constexpr int kFillThreads = 128, kFillBlocks = 6;
inline constexpr uint32_t kFillWarps = kFillThreads / 32;  // and rows of a group, which a block writes together
static_assert(kFillWarps <= uint32_t{kPieceEdge});

// Parts of rows that lie one behind the other.
struct FillGroup {
  uint64_t word;         // of coverage, the first row's
  uint32_t words, rows;  // of a part; how many there are
};

struct FillRoom {
  FillPart parts[kFillWarps];
  FillGroup groups[kFillWarps];
  uint32_t first;                              // of the groups, their number
  uint32_t spans[kFillWarps][kFillWarps][32];  // of a group's rows, see PackFillSpan; then their coverage
  uint32_t keys[kMostApart];
  SharedSetup setups[kMostApart];
};

// Sets up the largest triangles; how many there are. All threads of a block call it.
template <int kIdShader>
__device__ inline uint32_t SetUpFilled(const FillRowArgs& args, FillRoom& room) {
  const InPlaceArgs& place = args.place;
  const bool plain = place.negative != nullptr && *place.negative == 0;
  return SetUpApart(args.walk, room.setups, [&](uint32_t i, uint32_t t) {
    uint32_t key[1] = {};
    args.by_id ? KeysOf<kIdShader, 1>(place, plain, t, key) : KeysOf<-1, 1>(place, plain, t, key);
    room.keys[i] = key[0];
  });
}

// Voxels [begin, end) of a part of a row, and whose they are.
__device__ inline uint32_t PackFillSpan(int begin, int end, uint32_t triangle) {
  static_assert(kRowCells < 1 << 11 && kMostApart <= 32);
  return begin < end ? uint32_t(begin) | uint32_t(end) << 11 | triangle << 22 : 0;
}

// Finds the spans of a group of rows: those of its row r become spans[r]. Few triangles have rows of one group: of several rows they are
// found at once. `place` is the part of the first row. The voxels that the lane's spans have in whole rows, where the part begins one.
// All lanes of a warp call it.
__device__ inline uint32_t FindFillSpans(const FillRoom& room, uint32_t large, const RowPartPlace& place,
                                         uint32_t (&spans)[kFillWarps][32]) {
  const unsigned lane = threadIdx.x % 32;
  PieceLayer layer{};
  const bool draws = lane < large && FindLayer(room.setups[lane], place.y, place.z, layer);
  const uint32_t drawing = __ballot_sync(~0u, draws), count = uint32_t(__popc(drawing));
  if (draws) spans[0][__popc(drawing & ((1u << lane) - 1))] = lane;
  __syncwarp();
  // So many lanes take a row.
  const uint32_t each = count <= 8 ? 8 : count <= 16 ? 16 : 32, number = lane % each;
  const uint32_t triangle = number < count ? spans[0][number] : 0;
  __syncwarp();
  PieceLayer mine;
  mine.x_first = __shfl_sync(~0u, layer.x_first, int(triangle));
  mine.x_last = __shfl_sync(~0u, layer.x_last, int(triangle));
  mine.plane_lo = __shfl_sync(~0u, layer.plane_lo, int(triangle));
  mine.plane_hi = __shfl_sync(~0u, layer.plane_hi, int(triangle));
  const uint32_t rows = __shfl_sync(~0u, uint32_t(layer.begin) | uint32_t(layer.end) << 8, int(triangle));
#pragma unroll
  for (uint32_t row = 0; row < kFillWarps; ++row) spans[row][lane] = 0;
  __syncwarp();
  if (count == 0) return 0;
  uint32_t voxels = 0;
  const int width = int(place.words) * 32;
#pragma unroll 1
  for (uint32_t row = lane / each; row < kFillWarps; row += 32 / each) {
    int x_begin, x_end;
    if (number >= count || row < (rows & 0xff) || row >= rows >> 8) continue;
    if (!FindRow(room.setups[triangle], mine, place.y + int(row), x_begin, x_end)) continue;
    if (place.x == 0) voxels += uint32_t(x_end - x_begin);
    spans[row][number] = PackFillSpan(max(x_begin - place.x, 0), min(x_end - place.x, width), triangle);
  }
  return voxels;
}

// Writes a part of a row: its voxels go to `out`. In: the lane's triangle's voxels [begin, end) of it, and its key. The coverage of the
// lane's word. All lanes of a warp call it.
__device__ inline uint32_t FillRowPart(FillPart& part, uint4* out, int voxels, int begin, int end, uint32_t key) {
  const int lane = int(threadIdx.x % 32), units = voxels / 4;
  out += lane;
  if (__any_sync(~0u, begin < end) == 0) {
#pragma unroll
    for (int i = 0; i < kRowCells / 4; i += 32) {
      if (i + lane < units) __stcs(out + i, uint4{0, 0, 0, 0});
    }
    return 0;
  }
  part.covered[lane] = 0;
  __syncwarp();
  ForEachWordOf(begin, end, [&](int word, uint32_t mask) { atomicOr(part.covered + word, mask); });
  ForEachVoxel(uint32_t(end - begin), [&](int owner, uint32_t before, bool there) {
    const int x = __shfl_sync(~0u, begin, owner) + int(before);
    const uint32_t of_owner = __shfl_sync(~0u, key, owner);
    if (there) atomicMax(part.cells + x, of_owner);
  });
  __syncwarp();
  auto* const cells = reinterpret_cast<uint4*>(part.cells) + lane;
#pragma unroll
  for (int i = 0; i < kRowCells / 4; i += 32) {
    if (i + lane >= units) break;
    __stcs(out + i, cells[i]);
    cells[i] = uint4{0, 0, 0, 0};
  }
  const uint32_t covered = part.covered[lane];
  __syncwarp();
  return covered;
}

// The cells of a target. Blocks take the next groups of rows, as many as they have warps: what all blocks write meanwhile lies together, which
// memory takes a tenth faster than rows all over the target. A warp finds the spans of one group, then each writes a row of each.
// kIdShader: the shader of triangle ids.
template <int kIdShader>
__global__ void __launch_bounds__(kFillThreads, kFillBlocks) FillRows(const __grid_constant__ FillRowArgs args) {
  __shared__ alignas(16) char memory[sizeof(FillRoom)];
  auto& room = *reinterpret_cast<FillRoom*>(memory);
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  FillPart& part = room.parts[warp];
  for (int i = int(lane); i < kRowCells; i += 32) part.cells[i] = 0;
  __syncwarp();
  const uint32_t large = SetUpFilled<kIdShader>(args, room);
  const RowOrder parts(args.walk.grid, kRowCells / 32, kFillWarps);
  const auto words_per_row = uint32_t(args.walk.grid.words_per_row);
  uint64_t fragments = 0;
  for (;;) {
    if (threadIdx.x == 0) room.first = atomicAdd(args.taken, kFillWarps);
    __syncthreads();
    const uint32_t first = room.first;
    if (first >= parts.count) break;
    const RowPartPlace found = parts.Find(first + warp, 0);
    if (found.words != 0) fragments += FindFillSpans(room, large, found, room.spans[warp]);
    if (lane == 0) {
      const uint32_t rows = found.words == 0 ? 0 : uint32_t(args.walk.grid.dims[1] - found.y);
      room.groups[warp] = {found.word, found.words, rows};
    }
    __syncthreads();
#pragma unroll 1
    for (uint32_t i = 0; i < kFillWarps; ++i) {
      const FillGroup& group = room.groups[i];
      if (warp >= group.rows) continue;
      uint32_t& slot = room.spans[i][warp][lane];
      const uint32_t span = slot;
      auto* const out = reinterpret_cast<uint4*>(args.place.out + (group.word + warp * words_per_row) * 32);
      slot = FillRowPart(part, out, int(group.words) * 32, int(span & 0x7ff), int(span >> 11 & 0x7ff),
                         span == 0 ? 0 : room.keys[span >> 22]);
    }
    // The coverage at once, for the same reason.
    for (uint32_t i = 0; i < kFillWarps; ++i) {
      const FillGroup& group = room.groups[i];
      if (args.coverage == nullptr || warp >= group.rows || lane >= group.words) continue;
      args.coverage[group.word + warp * words_per_row + lane] = room.spans[i][warp][lane];
    }
  }
  if (args.fragments != nullptr && large > 0) AddFragments(args.fragments, fragments);
}

}  // namespace voxelpipe::cuda
