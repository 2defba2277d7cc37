// Occupancy bits: rasterizes triangles directly into the bit grid, without tiles. Atomic ORs set partial words; full
// words between them are stored.
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>

#include "cuda/device/device_caps.h"
#include "cuda/device/kernel_list.h"
#include "cuda/device/launch.cuh"
#include "cuda/occupancy/bit_bricks.h"
#include "cuda/occupancy/occupancy_kernels.cuh"
#include "cuda/occupancy/row_kernel.h"
#include "cuda/plan/occupancy_plan.h"
#include "cuda/traversal/mesh_locality.h"
#include "cuda/traversal/raster_args.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

// Iterations of CellKernel if locality matters: fewer triangles in flight, in fewer places of the grid.
constexpr int kOrderedRounds = 1;
constexpr int kSharedRows = 2;  // lanes of FewKernel per triangle if rows are shared
// Grids of at most so many bytes are cleared by the first blocks of the rasterization kernel; larger ones are cleared
// sooner by a separate kernel.
constexpr uint64_t kClearedByWalk = 4 << 20, kAssumedClearedByWalk = 8;  // the latter times the assumed cache size

// Resident blocks of a kernel per multiprocessor of the current device; 0 if unknown.
template <typename Kernel>
int ResidentBlocks(Kernel* kernel, int threads) {
  int blocks = 0;
  if (cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, threads, 0) == cudaSuccess) return blocks;
  (void)cudaGetLastError();
  return 0;
}

// Resident blocks of AtOnceKernel on the device; 0 if it does not support cooperative launches.
int BlocksAtOnce(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  return OfDevice(known, device, [&] {
    int cooperative = 0;
    if (cudaDeviceGetAttribute(&cooperative, cudaDevAttrCooperativeLaunch, device.ordinal) != cudaSuccess) {
      (void)cudaGetLastError();
    }
    if (cooperative == 0) return 0;
    return std::min(ResidentBlocks(AtOnceKernel, kAtOnceThreads), kAtOnceBlocks) * device.multiprocessors;
  });
}

// Resident blocks of FewKernel on the device. Thin coverage and two lanes per triangle need no more resources.
uint64_t FewBlocksAtOnce(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};
  const int resident =
      OfDevice(known, device, [] { return std::min(ResidentBlocks(FewKernel<false, 1>, kCellThreads), kCellBlocks); });
  return uint64_t(resident) * uint64_t(AssumedCache() > 0 ? 1 : device.multiprocessors);
}

// The grid and the mesh as the plan asks for them.
OccupancyInputs InputsOf(RunState& state, BitArgs& args) {
  const uint64_t assumed = AssumedCache();
  OccupancyInputs in;
  in.dims = {args.grid.dims[0], args.grid.dims[1], args.grid.slab_end - args.grid.slab_begin};
  in.bytes = args.quads * 16;
  in.triangles = args.triangle_count;
  in.alone = state.plan.path == Path::kOccupancy;
  in.fixed_point = HasFixed(args);
  in.has_ordered_copy = [&] {
    PrepareScattered(state);
    UsePacked(state, args, /*placed=*/true);
    return args.packed != nullptr;
  };
  in.needs_rows = [&] { return ManyGoByRows(state); };
  in.cache_bytes = CacheBytes(state.device);
  if (assumed == 0) {
    in.single_launch_triangles = uint64_t(BlocksAtOnce(state.device)) * (kAtOnceThreads / 32) * kAtOnceSetups;
  }
  in.resident_triangles = FewBlocksAtOnce(state.device) * kCellThreads;
  in.kernel_clear_bytes = assumed > 0 ? std::min(kClearedByWalk, assumed * kAssumedClearedByWalk) : kClearedByWalk;
  return in;
}

void CutIntoPieces(const BitArgs& args, Bins& bins) {
  const auto pieces_along = [](int64_t n, int64_t edge) { return uint32_t((n + edge - 1) / edge); };
  bins.dims[0] = pieces_along(args.grid.dims[0], kPieceWords * 32);
  bins.dims[1] = pieces_along(args.grid.dims[1], kPieceEdge);
  bins.dims[2] = pieces_along(args.grid.slab_end - args.grid.slab_begin, kPieceEdge);
  bins.z_begin = 0;
  bins.z_end = bins.dims[2];
}

// Excludes grid blocks along z that the mesh's box does not reach, with a margin of some voxels; keeps at least one.
void LeaveOutEmpty(const RunState& state, const BitArgs& args, Bins& bins) {
  const auto layer = [&](const Vec3d& p) {
    return WorldToIndex(state.grid.index_space(), p).z - double(args.grid.slab_begin);
  };
  const double most = double(bins.dims[2]);
  bins.z_begin = uint32_t(Clamp(std::floor((layer(state.box.min) - 3) / kPieceEdge), 0.0, most - 1));
  bins.z_end = uint32_t(Clamp(std::ceil((layer(state.box.max) + 3) / kPieceEdge), double(bins.z_begin) + 1, most));
}

// Allocates the bins of OccupancyPath::kBlocks. False if they find no memory.
bool MakeBins(RunState& state, const BitArgs& args, Bins& bins) {
  const uint64_t count = args.triangle_count;
  CutIntoPieces(args, bins);
  LeaveOutEmpty(state, args, bins);
  const uint64_t pieces = uint64_t{bins.dims[0]} * bins.dims[1] * bins.dims[2];
  if (pieces >= UINT32_MAX / kBinRoom) return false;
  const auto whole = [](uint64_t bytes) { return (bytes + 255) / 256 * 256; };
  const uint64_t set_up = whole(count * sizeof(SharedSetup)), counts = whole(pieces * 4),
                 bits = whole((count + 31) / 32 * 4);
  if (!state.scratch.Resize(set_up + counts + bits + pieces * kBinRoom * 4, state.stream).ok()) return false;
  uint8_t* const room = state.scratch.data();
  bins.set_up = reinterpret_cast<SharedSetup*>(room);
  bins.counts = reinterpret_cast<uint32_t*>(room + set_up);
  bins.overflowed = reinterpret_cast<uint32_t*>(room + set_up + counts);
  bins.triangles = reinterpret_cast<uint32_t*>(room + set_up + counts + bits);
  return true;
}

// The functions below append kernels to a list, which is launched when it is complete.

template <bool kQuads, bool kListed, int kThreads>
void AddStore(const RunState& state, const BitArgs& args, const Bins& bins, LaunchList& list) {
  const dim3 blocks(bins.dims[0], bins.dims[1], std::min(bins.z_end - bins.z_begin, kStoreDepth));
  list.Add("StoreKernel", EarlyIfAble(state.device), blocks, kThreads, StoreKernel<kQuads, kListed, kThreads>, args,
           bins);
}

void AddClear(const RunState& state, const BitArgs& args, LaunchList& list) {
  const auto processors = unsigned(state.device.multiprocessors);
  list.Add("ClearKernel", Begins::kBehind, BlocksFor(args.quads / 4, kClearThreads, processors * 16), kClearThreads,
           ClearKernel, args);
}

void AddStores(const RunState& state, const BitArgs& args, const Bins& bins, LaunchList& list) {
  const uint64_t pieces = uint64_t{bins.dims[0]} * bins.dims[1] * (bins.z_end - bins.z_begin);
  const bool quads = args.grid.words_per_row % 4 == 0, listed = bins.counts != nullptr;
  if (!listed) {
    quads ? AddStore<true, false, 64>(state, args, bins, list) : AddStore<false, false, 64>(state, args, bins, list);
  } else if (!quads) {
    AddStore<false, true, 64>(state, args, bins, list);
  } else if (args.triangle_count < pieces) {
    AddStore<true, true, 64>(state, args, bins, list);
  } else {
    AddStore<true, true, 128>(state, args, bins, list);  // several triangles per grid block
  }
}

void AddLayers(const RunState& state, const BitArgs& args, LaunchList& list) {
  list.Add("LayerKernel", EarlyIfAble(state.device), unsigned(state.device.multiprocessors) * kLayerBlocks,
           kLayerThreads, LayerKernel, args);
}

void AddPieces(const RunState& state, const BitArgs& args, const Bins& bins, LaunchList& list) {
  const auto processors = unsigned(state.device.multiprocessors);
  // Few blocks, so that BinKernel runs concurrently.
  list.Add("ClearForBins", Begins::kBehind, processors * 4, kClearThreads, ClearForBins, args, bins);
  const unsigned blocks = processors * kBinBlocks;
  const bool few = args.triangle_count <= uint64_t{blocks} * (kBinThreads / 32) * kMaxInParts;
  list.Add("BinKernel", EarlyIfAble(state.device), blocks, kBinThreads, few ? BinKernel<true> : BinKernel<false>, args,
           bins);
  AddStores(state, args, bins, list);
  AddLayers(state, args, list);
}

void AddAtOnce(RunState& state, const BitArgs& args, int blocks, LaunchList& list) {
  // The grid barrier uses the last queue counter, which Path::kOccupancy does not use otherwise.
  auto* const arrived = reinterpret_cast<unsigned*>(state.counters.data() + kQueued3);
  list.Add("AtOnceKernel", Begins::kAtOnce, unsigned(blocks), kAtOnceThreads, AtOnceKernel, args, arrived);
}

// Clears the grid, and draws the largest triangles into it if there are any: they then cost no memory traffic besides
// the grid's own, whereas atomics cost one access per row of each triangle.
absl::Status AddCleared(RunState& state, const BitArgs& args, LaunchList& list) {
  if (args.largest == nullptr) {
    AddClear(state, args, list);
    return absl::OkStatus();
  }
  VOXELPIPE_OK_OR_RETURN(state.scratch.Resize(kMaxApart * sizeof(SharedSetup), state.stream));
  Bins bins;
  CutIntoPieces(args, bins);
  bins.set_up = reinterpret_cast<SharedSetup*>(state.scratch.data());
  list.Add("SetUpLargestKernel", Begins::kBehind, (kMaxApart + kMaxInParts - 1) / kMaxInParts, 32, SetUpLargestKernel,
           args, bins.set_up);
  AddStores(state, args, bins, list);
  return absl::OkStatus();
}

template <bool kThin>
auto* FewKernelFor(int row_lanes) {
  return row_lanes == kSharedRows ? FewKernel<kThin, kSharedRows> : FewKernel<kThin, 1>;
}

template <bool kThin>
auto* CellKernelFor(const BitArgs& args) {
  if (args.pool.places != nullptr) return CellKernel<kThin, false, BitSink::kBricks>;
  if (args.packed == nullptr) return CellKernel<kThin, false, BitSink::kWords>;
  return CellKernel<kThin, true, BitSink::kTogether>;
}
void AddCells(RunState& state, BitArgs& args, int row_lanes, LaunchList& list) {
  const bool few = row_lanes > 0, thin = args.coverage == Coverage::kThin;
  const uint64_t each = few ? uint64_t(kCellThreads / row_lanes) : uint64_t(args.rounds) * kCellThreads;
  const auto blocks = unsigned((args.triangle_count + each - 1) / each);
  const Begins begins = args.clear_blocks == 0 ? EarlyIfAble(state.device) : Begins::kBehind;
  if (few) {
    list.Add("FewKernel", begins, args.clear_blocks + blocks, kCellThreads,
             thin ? FewKernelFor<true>(row_lanes) : FewKernelFor<false>(row_lanes), args);
  } else {
    list.Add("CellKernel", begins, args.clear_blocks + blocks, kCellThreads,
             thin ? CellKernelFor<true>(args) : CellKernelFor<false>(args), args);
  }
  if (args.pool.places != nullptr) AddStorePool(state, args, list);
  AddLayers(state, args, list);
}

// Appends all kernels of a call. `args` is complete except for what depends on the plan.
absl::Status AddAll(RunState& state, BitArgs& args, LaunchList& list) {
  OccupancyInputs in = InputsOf(state, args);
  OccupancyPlan plan = PlanOccupancy(in);
  Bins bins;
  if (plan.path == OccupancyPath::kBlocks && !MakeBins(state, args, bins)) {
    in.without_blocks = true;
    plan = PlanOccupancy(in);
  }
  if (plan.path == OccupancyPath::kBricks && !MakeBitPool(state, args)) {
    in.without_bricks = true;
    plan = PlanOccupancy(in);
  }
  args.rounds = plan.keeps_together ? kOrderedRounds
                                    : RoundsFor(args.triangle_count, kCellThreads,
                                                uint64_t(state.device.multiprocessors) * kCellBlocks, kMaxCellRounds);
  if (plan.draws_largest) args.largest = state.scattered_mesh.largest;
  switch (plan.path) {
    case OccupancyPath::kClear: AddClear(state, args, list); break;
    case OccupancyPath::kBlocks: AddPieces(state, args, bins, list); break;
    case OccupancyPath::kSingleLaunch: AddAtOnce(state, args, BlocksAtOnce(state.device), list); break;
    case OccupancyPath::kBricks:
      AddClearPool(state, args, list);
      AddCells(state, args, 0, list);
      break;
    case OccupancyPath::kRows:
      VOXELPIPE_OK_OR_RETURN(AddCleared(state, args, list));
      AddRows(state, args, plan.rows_together, list);
      AddLayers(state, args, list);
      break;
    case OccupancyPath::kResident:
    case OccupancyPath::kTriangles:
      if (plan.clears_in_kernel) {
        args.clear_blocks = BlocksFor(args.quads, uint64_t{kCellThreads} * 4, uint64_t(state.device.multiprocessors));
        args.cleared = reinterpret_cast<uint32_t*>(state.counters.data() + kCleared);
      } else {
        VOXELPIPE_OK_OR_RETURN(AddCleared(state, args, list));
      }
      AddCells(state, args, plan.lanes_per_triangle, list);
      break;
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words) {
  VOXELPIPE_OK_OR_RETURN(EnsureCounters(state));
  BitArgs args;
  args.grid = state.view;
  args.grid.slab_begin = z_begin;
  args.grid.slab_end = z_end;
  args.bits = bits;
  args.quads = (words + 3) / 4;  // a DeviceArray is padded to whole units
  args.coverage = coverage;
  SetTriangles(state, args);
  for (int i = 0; i < kBitQueues; ++i) {
    VOXELPIPE_OK_OR_RETURN(state.queue[i].Resize(std::max<uint64_t>(args.triangle_count, 1), state.stream));
  }
  args.layer_queue = state.queue[0].data();
  args.large_queue = state.queue[1].data();
  args.queued = state.counters.data() + kQueued0;
  LaunchList list;
  VOXELPIPE_OK_OR_RETURN(AddAll(state, args, list));
  absl::Status launched = state.graphs.Launch(list, state.device.ordinal, state.stream);
  if (!launched.ok()) {  // the last kernels may not have reset their counters
    (void)ClearCounters(state, {kCleared, kQueued3});
  }
  return launched;
}

}  // namespace voxelpipe::cuda
