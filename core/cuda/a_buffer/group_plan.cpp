#include "cuda/a_buffer/group_plan.h"

#include <algorithm>
#include <bit>

#include "cuda/device/device_caps.h"
#include "cuda/primitives/span.h"
#include "cuda/traversal/mesh_locality.h"

namespace voxelpipe::cuda {
namespace {

// How many voxels a triangle of the mesh touches under conservative coverage, on the average, by a sample. Wherever it
// lies, it is as many, on the average, as the volume that a box of a voxel sweeps when its centre goes all over the
// triangle: 1, and the lengths of the triangle's projections on the axes, and the areas of those on the planes between
// them.
double VoxelsOfTriangle(const RunState& state) {
  constexpr uint64_t kSamples = 128;
  const TriangleMesh& mesh = state.host.mesh;
  const uint64_t count = mesh.triangles.size(), samples = std::min(count, kSamples);
  double sum = 0;
  for (uint64_t i = 0; i < samples; ++i) {
    const auto& corners = mesh.triangles[count / samples * i];
    double edges[2][3], voxels = 1;
    for (int a = 0; a < 3; ++a) {
      double least = 0, largest = 0;
      for (int e = 0; e < 2; ++e) {
        edges[e][a] =
            (mesh.positions[corners[size_t(e) + 1]][a] - mesh.positions[corners[0]][a]) / state.grid.voxel_size[a];
        least = std::min(least, edges[e][a]);
        largest = std::max(largest, edges[e][a]);
      }
      voxels += largest - least;
    }
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3;
      voxels += Abs(edges[0][a] * edges[1][b] - edges[0][b] * edges[1][a]) / 2;
    }
    sum += voxels;
  }
  return sum / double(std::max<uint64_t>(samples, 1));
}

}  // namespace

std::optional<BundlePlan> PlanBundles(RunState& state) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  BundlePlan plan;
  plan.code.id_bits = uint32_t(std::max(1, int(std::bit_width(triangles - 1))));
  static_assert(kMaxSpanTriangles <= uint64_t{1} << BundleCode::kMaxIdBits);
  if (triangles > kMaxSpanTriangles) return std::nullopt;
  if (ShadesFragments(state.request) || !state.targets.any_always_present || IsScattered(state)) return std::nullopt;
  plan.code.followers = std::min(32 - plan.code.id_bits, BundleCode::kMaxFollowers);
  // Measured: of spheres of 2 to 8 voxels a triangle some 0.7 bundles for each voxel but for the first 1.6.
  constexpr double kMaxVoxels = 12, kShared = 1.6, kBundles = .7, kLeast = .25;
  const double voxels = VoxelsOfTriangle(state), bundles = std::max(kLeast, kBundles * (voxels - kShared));
  // What fits into the cache is sorted in less time than the host takes to learn how many bundles there are.
  if (!(voxels <= kMaxVoxels) || !ExceedsCache(state.device, uint64_t(voxels * double(triangles)) * sizeof(uint32_t))) {
    return std::nullopt;
  }
  // The rest of the room is for fragments that are not yet bundled, and for places with more. More rounds gained
  // nothing.
  constexpr double kFilled = .65 * kBundleRoom, kMaxRounds = 4;
  plan.rounds = uint32_t(std::clamp(kFilled / (bundles * kBundledTriangles), 1., kMaxRounds));
  return plan;
}

}  // namespace voxelpipe::cuda
