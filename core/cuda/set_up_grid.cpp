// Sets up the grid of a run, its path plan, and the mesh in index space.
#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "cuda/run/run_state.h"
#include "cuda/traversal/mesh_locality.h"
#include "grid/index_space.h"
#include "host_mesh/vertex_shade.h"
#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe::cuda {
namespace {

constexpr double kFarthest = 0x1p40;  // voxels

bool InReach(const Vec3d& p) {
  return Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest;
}

// Index space is monotonic in world space, so the corners of the mesh's box show whether any vertex is out of range.
// The host searches for it, since the run ends with an error.
absl::Status CheckReach(RunState& state, const GridSpec& grid) {
  const IndexSpace space = grid.index_space();
  const auto place = [&](const Vec3d& p) { return WorldToIndex(space, p); };
  if (state.host.view.triangle_count == 0 || (InReach(place(state.box.min)) && InReach(place(state.box.max)))) {
    return absl::OkStatus();
  }
  if (state.shaded_there) VOXELPIPE_OK_OR_RETURN(ShadeVertices(state.host));
  uint32_t bad = UINT32_MAX;
  const MeshView& mesh = state.host.view;
  for (uint64_t t = 0; t < mesh.triangle_count; ++t) {
    for (const uint32_t v : mesh.triangles[t]) {
      if (!InReach(place(mesh.positions[v]))) {
        bad = std::min(bad, v);
        break;  // like the CPU backend: reports the first such corner of the triangle
      }
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(DescribeVertex(state.host.mesh, bad), ": farther than 2^40 voxels from the grid's origin"));
}

// True if some kernel reads vertices in index space.
bool NeedsPlaces(const RunState& state) {
  if (state.request.request.result == ResultKind::kBuckets) return ShadesFragments(state.request);
  if (!state.plan.blends()) return true;  // fills
  for (int i = 0; i < state.targets.count; ++i) {
    const ValueSource source = state.plan.targets[size_t(i)].source;
    const bool shades_fragments = source == ValueSource::kOwners || source == ValueSource::kFragments;
    if (shades_fragments && TraitsOf(state.targets.at[i].shader).needs_plane) return true;
  }
  return false;
}

// Reported as out of memory, so that thinner slabs or another backend are tried.
absl::Status TooMuch(const std::string& what) {
  return MarkDeviceFailure(absl::ResourceExhaustedError(what), DeviceFailureKind::kOutOfMemory);
}

}  // namespace

absl::Status SetUpGrid(RunState& state, const GridSpec& grid) {
  state.grid = grid;
  for (int a = 0; a < 3; ++a) state.view.dims[a] = grid.dims[size_t(a)];
  state.view.tiles = TilesOf(state.view.dims);
  state.view.words_per_row = (state.view.dims[0] + 31) / 32;
  state.view.space = grid.index_space();
  // Rows and fragments of a triangle are counted in 32 bits. A plane intersects at most five voxels of a column along
  // the dominant axis of its normal, so the grid's largest face bounds both.
  const auto nx = double(grid.dims[0]), ny = double(grid.dims[1]), nz = double(grid.dims[2]);
  if (5 * Max(nx * ny, Max(ny * nz, nz * nx)) > double(UINT32_MAX)) {
    return TooMuch("a face of the grid has more voxels than the CUDA backend counts for one triangle");
  }
  VOXELPIPE_OK_OR_RETURN(CheckReach(state, grid));
  state.placed = false;
  state.path_inputs = PathInputsOf(state, grid);
  state.plan = PlanPath(state.path_inputs);
  const Path path = state.plan.path;
  const uint64_t layers = std::min<uint64_t>(kSlabGranularity, uint64_t(grid.dims[2]));
  if (path != Path::kOccupancy &&
      uint64_t(state.view.words_per_row) * 32 * uint64_t(grid.dims[1]) * layers > kMaxSpanBits) {
    return TooMuch("eight layers of the grid have more voxels than the CUDA backend has numbers for, 2^32");
  }
  if (path == Path::kFragmentList || state.plan.blends()) PrepareScattered(state);
  if (path == Path::kOccupancy) return absl::OkStatus();  // kernels read world-space vertices
  for (SpanTarget& target : state.span_targets) target.shaded = false;
  if (NeedsPlaces(state)) VOXELPIPE_OK_OR_RETURN(PlaceVertices(state));
  if (state.mesh.view.empty() || state.mesh.host_view.index_positions != state.mesh.index_positions.data()) {
    state.mesh.host_view.index_positions = state.mesh.index_positions.data();
    std::copy_n(state.grid.dims.data(), 3, state.mesh.host_view.grid_dims);
    VOXELPIPE_OK_OR_RETURN(state.mesh.view.Upload({&state.mesh.host_view, 1}, state.stream));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
