// Blending without tiles: dense targets whose blend is one 32-bit atomic and whose value is the same for all fragments of a triangle.
//
// Rows of triangles go straight to the result. min and max are kept as keys (tile_blend.cuh) under which 0, the stored clear value, lies
// below every value; the keys of covered voxels become values at the end. Everything else goes by tiles.
#include <algorithm>

#include "cuda/uniform_value.cuh"
#include "cuda/walk.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

enum class Atomic : uint8_t { kMax, kMaxOfComplement, kOr, kCount };

struct BlendDirect {
  GridView grid;
  const FineArgs* shading;  // in device memory, of one target
  uint32_t* out;            // the dense target
  uint32_t* coverage;       // bit grid; null: another target's walk sets it, and counts
  uint64_t* fragments;      // kFragmentSlots counters
  int components;
  bool planar;
  Atomic atomic;
  uint64_t voxels;  // of the slab
  // Of the thread
  uint32_t triangle = UINT32_MAX;
  uint32_t value[4] = {0, 0, 0, 0};
  uint64_t count = 0;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t t) { triangle = t; }
  __device__ void End(uint32_t) {}
  __device__ void Row(int y, int z, int x_begin, int x_end) {
    Shade();
    Put(y, z, x_begin, x_end);
  }
  __device__ void SharedRow(uint32_t t, int y, int z, int x_begin, int x_end) {
    triangle = t;
    Shade();
    Put(y, z, x_begin, x_end);
  }
  __device__ void Finish() {
    if (coverage == nullptr) return;
    for (int step = 16; step > 0; step /= 2) count += __shfl_down_sync(~0u, count, step);
    if (threadIdx.x % 32 == 0 && count > 0) {
      atomicAdd(reinterpret_cast<unsigned long long*>(fragments + blockIdx.x % kFragmentSlots), count);
    }
  }

 private:
  uint32_t shaded_ = UINT32_MAX;

  __device__ void Shade() {
    if (shaded_ == triangle) return;
    shaded_ = triangle;
    if (atomic == Atomic::kCount) return;
    UniformValue made;
    ShadeUniform(*shading, triangle, made);
#pragma unroll
    for (int c = 0; c < 4; ++c) {
      value[c] = atomic == Atomic::kMaxOfComplement ? ~uint32_t(made.component[c]) : uint32_t(made.component[c]);
    }
  }

  __device__ void Put(int y, int z, int x_begin, int x_end) {
    if (coverage != nullptr) {
      count += uint64_t(x_end - x_begin);
      uint32_t* const row = coverage + grid.Word(0, y, z);
      for (int w = x_begin / 32; w <= (x_end - 1) / 32; ++w) {
        const uint32_t from = w == x_begin / 32 ? ~0u << (x_begin % 32) : ~0u;
        const uint32_t upto = w == (x_end - 1) / 32 ? ~0u >> (31 - (x_end - 1) % 32) : ~0u;
        atomicOr(row + w, from & upto);
      }
    }
    const uint64_t first =
        (uint64_t{uint32_t(grid.dims[1])} * uint32_t(z - grid.slab_begin) + uint64_t(y)) * uint32_t(grid.dims[0]);
    for (int x = x_begin; x < x_end; ++x) {
#pragma unroll
      for (int c = 0; c < 4; ++c) {
        if (c >= components) break;
        const uint64_t n = first + uint64_t(x);
        uint32_t* const cell = out + (planar ? uint64_t(c) * voxels + n : n * uint64_t(components) + uint64_t(c));
        if (atomic == Atomic::kCount) {
          atomicAdd(cell, 1u);
        } else if (atomic == Atomic::kOr) {
          atomicOr(cell, value[c]);
        } else {
          atomicMax(cell, value[c]);
        }
      }
    }
  }
};

struct KeyArgs {
  const uint32_t* coverage;  // bit grid
  uint32_t* out;
  uint64_t words, voxels;
  int64_t nx, words_per_row;
  int components;
  bool planar, complement, is_float;
};

// The keys of covered voxels become values. A warp a word of coverage, a lane a voxel.
__global__ void __launch_bounds__(kThreads) KeysToValues(const __grid_constant__ KeyArgs args) {
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  const unsigned lane = threadIdx.x % 32;
  // Words are looked at 32 at a time: most are empty.
  for (uint64_t begin = (uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32) * 32; begin < args.words;
       begin += warps * 32) {
    const uint32_t mine = begin + lane < args.words ? args.coverage[begin + lane] : 0;
    for (uint32_t left = __ballot_sync(~0u, mine != 0); left != 0; left &= left - 1) {
      const int source = __ffs(int(left)) - 1;
      const uint32_t bits = __shfl_sync(~0u, mine, source);
      if ((bits >> lane & 1) == 0) continue;
      const uint64_t word = begin + uint64_t(source);
      const uint64_t row = word / uint64_t(args.words_per_row), w = word % uint64_t(args.words_per_row);
      const uint64_t n = row * uint64_t(args.nx) + w * 32 + lane;
      for (uint64_t c = 0; c < uint64_t(args.components); ++c) {
        uint32_t* const cell = args.out + (args.planar ? c * args.voxels + n : n * uint64_t(args.components) + c);
        const uint32_t key = args.complement ? ~*cell : *cell;
        *cell = args.is_float ? BitsOfKey(key) : key;
      }
    }
  }
}

// Whether the target's blend is one atomic on its stored cells, beginning from the clear value.
bool IsDirect(const RunState& state, const CudaTarget& target) {
  if (target.clear_stored != 0 || !IsUniform(state, target)) return false;
  const bool u32 = target.format == VoxelFormat::kU32, f32 = target.format == VoxelFormat::kF32;
  if (target.blend == Blend::kMin || target.blend == Blend::kMax) return u32 || f32;
  return u32 && (target.blend == Blend::kOr || target.blend == Blend::kCount);
}

// Atomics that miss the L2 cache cost more than sorting into tiles once many small triangles write to a large target; measured on
// an H200 (tests/bench/RESULTS.md): 10 M triangles gain at 512^3 and lose at 1024^3, 2 M gain at both.
constexpr uint64_t kLargeTarget = uint64_t{1} << 30, kManyTriangles = 4'000'000;

}  // namespace

bool BlendsDirectly(const RunState& state, const GridSpec& grid) {
  const VoxelizeRequest& request = state.request.request;
  if (request.result != ResultKind::kDense) return false;
  bool any = false;
  const uint64_t voxels = uint64_t(grid.dims[0]) * uint64_t(grid.dims[1]) * uint64_t(grid.dims[2]);
  for (size_t i = 0; i < request.targets.size(); ++i) {
    const CudaTarget target = DescribeTarget(request.targets[i], state.request.fragment_shaders[i]);
    if (target.is_occupancy) continue;
    if (!IsDirect(state, target)) return false;
    const bool large = voxels * uint64_t(target.components) * sizeof(uint32_t) > kLargeTarget;
    if (large && state.host.view.triangle_count > kManyTriangles) return false;
    any = true;
  }
  return any;
}

absl::Status BlendDirectly(RunState& state) {
  uint64_t* const slots = state.counters.data() + kCounters;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(slots, 0, kFragmentSlots * sizeof(uint64_t), state.stream));
  bool covered = false;
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (target.is_occupancy) continue;
    FineArgs shading;
    shading.mesh = state.mesh.view.data();
    shading.targets[0].target = target;
    shading.targets[0].kept = KeptBy(target);
    shading.targets[0].is_float = target.format == VoxelFormat::kF32;
    shading.target_count = 1;
    shading.traits = TraitsOf(target.shader);
    DeviceArray<FineArgs> on_device;
    VOXELPIPE_OK_OR_RETURN(on_device.Upload({&shading, 1}, state.stream));
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0, kQueued1, kQueued2, kQueued3}));
    const absl::StatusOr<WalkArgs> args = MakeWalkArgs(state);
    if (!args.ok()) return args.status();
    BlendDirect op;
    op.grid = state.view;
    op.shading = on_device.data();
    op.out = reinterpret_cast<uint32_t*>(target.dense);
    op.coverage = covered ? nullptr : state.coverage.data();
    op.fragments = slots;
    op.components = target.components;
    op.planar = state.targets.planar;
    op.voxels = state.slab_voxels();
    op.atomic = target.blend == Blend::kMin     ? Atomic::kMaxOfComplement
                : target.blend == Blend::kMax   ? Atomic::kMax
                : target.blend == Blend::kCount ? Atomic::kCount
                                                : Atomic::kOr;
    VOXELPIPE_OK_OR_RETURN(Walk(state, *args, op));
    covered = true;
    const bool is_float = target.format == VoxelFormat::kF32;
    if (target.blend == Blend::kMin || (target.blend == Blend::kMax && is_float)) {
      KeyArgs keys;
      keys.coverage = state.coverage.data();
      keys.out = op.out;
      keys.words = state.slab_words();
      keys.voxels = state.slab_voxels();
      keys.nx = state.view.dims[0];
      keys.words_per_row = state.view.words_per_row;
      keys.components = target.components;
      keys.planar = state.targets.planar;
      keys.complement = target.blend == Blend::kMin;
      keys.is_float = is_float;
      const uint64_t blocks = std::clamp<uint64_t>((keys.words + kThreads - 1) / kThreads, 1, 1 << 16);
      KeysToValues<<<unsigned(blocks), kThreads, 0, state.stream>>>(keys);
      VOXELPIPE_LAUNCHED_OR_RETURN("KeysToValues");
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
