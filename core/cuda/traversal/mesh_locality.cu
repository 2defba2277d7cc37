// Measures a mesh's locality by a sample, and makes its packed and Morton-ordered copies.
#include "cuda/traversal/mesh_locality.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "cuda/device/launch.cuh"
#include "cuda/run/fragment_list.h"
#include "cuda/traversal/raster_args.cuh"
#include "mesh/content_id.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;
constexpr uint64_t kHead = 2560;  // bytes before the packed corners, for LargestTriangles
// A triangle is large if its extent along an axis is at least 1/kLargeShare of the mesh's box.
constexpr double kLargeShare = 8;
static_assert(sizeof(LargestTriangles) <= kHead);

struct PackArgs {
  const Vec3d* positions = nullptr;
  const uint32_t* triangles = nullptr;
  uint64_t triangle_count = 0;
  Vec3d least, part, large;  // minimum corner of the box, quantization step, and extent of a large triangle
  PackedVertex* packed = nullptr;
  LargestTriangles* largest = nullptr;  // empty at first
  uint32_t *keys = nullptr, *numbers = nullptr;
};

constexpr int kMortonBits = 10;  // per axis

// Inserts two zero bits between the ten bits of v.
__device__ inline uint32_t SpreadBits(uint32_t v) {
  v = (v | v << 16) & 0x030000ffu;
  v = (v | v << 8) & 0x0300f00fu;
  v = (v | v << 4) & 0x030c30c3u;
  return (v | v << 2) & 0x09249249u;
}
__device__ inline uint32_t MortonCode(const PackedVertex& v) {
  constexpr int kDown = 32 - kMortonBits;
  return SpreadBits(v.at[0] >> kDown) | SpreadBits(v.at[1] >> kDown) << 1 | SpreadBits(v.at[2] >> kDown) << 2;
}

__global__ void __launch_bounds__(kThreads) PackScattered(const __grid_constant__ PackArgs args) {
  const uint64_t me = uint64_t(blockIdx.x) * kThreads + threadIdx.x, threads = uint64_t(gridDim.x) * kThreads;
  for (uint64_t t = me; t < args.triangle_count; t += threads) {
    const Corners c = LoadCorners(args.triangles, t);
    const Vec3d corners[3] = {args.positions[c.v[0]], args.positions[c.v[1]], args.positions[c.v[2]]};
    for (int i = 0; i < 3; ++i) {
      PackedVertex packed{};
      for (int a = 0; a < 3; ++a) packed.at[a] = PackCoordinate(corners[i][a], args.least[a], args.part[a]);
      packed.triangle = uint32_t(t);
      args.packed[3 * t + uint64_t(i)] = packed;
      if (i == 0) args.keys[t] = MortonCode(packed);
    }
    args.numbers[t] = uint32_t(t);
    const Vec3d &p = corners[0], &q = corners[1], &r = corners[2];
    bool large = false;
    for (int a = 0; a < 3; ++a) {
      large = large || Max(p[a], Max(q[a], r[a])) - Min(p[a], Min(q[a], r[a])) >= args.large[a];
    }
    // The exact count beyond the capacity is not needed, and returning atomics on one counter are slow under
    // contention.
    if (!large || __ldcg(&args.largest->count) >= kMaxApart) continue;
    const uint32_t at = atomicAdd(&args.largest->count, 1u);
    if (at >= kMaxApart) continue;
    args.largest->triangles[at] = uint32_t(t);
    for (int i = 0; i < 3; ++i) args.largest->corners[at][i] = corners[i];
  }
}

// Copies the corners of triangles in the order of `numbers`. One thread per corner.
__global__ void __launch_bounds__(kThreads)
    PlaceScattered(const PackedVertex* packed, const uint32_t* numbers, uint64_t corners, PackedVertex* placed) {
  for (uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x; i < corners; i += uint64_t(gridDim.x) * kThreads) {
    placed[i] = packed[3 * uint64_t{numbers[i / 3]} + i % 3];
  }
}

// `room`: memory for the head and two copies of all corners.
absl::Status Pack(RunState& state, const Vec3d& extent, uint8_t* room) {
  const MeshView& mesh = state.mesh.host_view;
  PackArgs args;
  args.positions = mesh.positions;
  args.triangles = state.mesh.triangle_list();
  args.triangle_count = mesh.triangle_count;
  args.least = state.box.min;
  for (int a = 0; a < 3; ++a) {
    args.part[a] = PartOf(extent[a]);
    args.large[a] = extent[a] > 0 ? extent[a] / kLargeShare : HUGE_VAL;
  }
  args.packed = reinterpret_cast<PackedVertex*>(room + kHead);
  args.largest = reinterpret_cast<LargestTriangles*>(room);
  Fragments by_place;
  by_place.count = args.triangle_count;
  VOXELPIPE_OK_OR_RETURN(by_place.MakeRoom(state.stream));
  args.keys = by_place.keys[0].data();
  args.numbers = by_place.triangles[0].data();
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(room, 0, kHead, state.stream));
  PackScattered<<<BlocksFor(args.triangle_count, kThreads), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("PackScattered");
  VOXELPIPE_OK_OR_RETURN(SortFragmentList(by_place, 3 * kMortonBits, state.scratch, state.stream));
  const uint64_t corners = 3 * args.triangle_count;
  PlaceScattered<<<BlocksFor(corners, kThreads), kThreads, 0, state.stream>>>(
      args.packed, by_place.triangles[by_place.current].data(), corners, args.packed + corners);
  VOXELPIPE_LAUNCHED_OR_RETURN("PlaceScattered");
  return absl::OkStatus();
}

// The packed mesh, cached with the mesh if its positions are and triangles are numbered by id; null if memory is short.
const uint8_t* MakePacked(RunState& state, const Vec3d& extent) {
  const uint64_t bytes = kHead + 2 * 3 * state.mesh.host_view.triangle_count * sizeof(PackedVertex);
  const SharedArrays shared = SharedArraysOf(state.host.mesh.content_id);
  if (shared.positions && !shared.id.empty() && state.mesh.as_loaded && state.parts.ids_in_order) {
    auto array = CachedMade(
        state.device.ordinal, absl::StrCat(shared.id, "/scattered"), bytes, state.stream,
        [&](uint8_t* room) { return Pack(state, extent, room); }, Keeping::kIfRoom);
    if (!array.ok()) return nullptr;
    state.scattered_mesh.kept = *std::move(array);
    return state.scattered_mesh.kept->data();
  }
  DeviceArray<uint8_t>& own = state.scattered_mesh.own;
  if (!own.Resize(bytes, state.stream).ok()) return nullptr;
  if (!Pack(state, extent, own.data()).ok()) own.Free();
  return own.data();
}

}  // namespace

bool IsScattered(RunState& state) {
  if (state.scattered) return *state.scattered;
  constexpr uint64_t kSamples = 128;
  const TriangleMesh& mesh = state.host.mesh;
  const uint64_t count = state.mesh.host_view.triangle_count;
  uint64_t apart = 0;
  const bool known = count >= 32 * kSamples && mesh.triangles.size() == count;
  for (uint64_t i = 0; i < kSamples && known; ++i) {
    const uint64_t t = count / kSamples * i;
    const Vec3d& a = mesh.positions[mesh.triangles[t][0]];
    const Vec3d& b = mesh.positions[mesh.triangles[t + 1][0]];
    bool far = false;
    for (int k = 0; k < 3; ++k) {
      far = far || Abs(a[k] - b[k]) * 16 > state.grid.voxel_size[k] * double(state.view.dims[k]);
    }
    apart += far ? 1 : 0;
  }
  state.scattered = apart * 2 > kSamples;
  return *state.scattered;
}

void PrepareScattered(RunState& state) {
  ScatteredMesh& made = state.scattered_mesh;
  if (made.tried || state.request.request.coverage == Coverage::kCenter || !IsScattered(state)) return;
  made.tried = true;
  const Vec3d extent = state.box.max - state.box.min;
  if (!(Max(extent.x, Max(extent.y, extent.z)) < 0x1p900)) return;
  const uint8_t* const room = MakePacked(state, extent);
  if (room == nullptr) return;
  made.largest = reinterpret_cast<const LargestTriangles*>(room);
  made.packed = reinterpret_cast<const PackedVertex*>(room + kHead);
  made.placed = made.packed + 3 * state.mesh.host_view.triangle_count;
  made.extent = extent;
}

}  // namespace voxelpipe::cuda
