// Chooses the parameters of fragment groups for an A-buffer, or none, by a sample of the mesh's triangles.
#include "cuda/a_buffer/group_plan.h"

#include <algorithm>
#include <bit>

#include "cuda/device/device_caps.h"
#include "cuda/primitives/span.h"
#include "cuda/traversal/mesh_locality.h"

namespace voxelpipe::cuda {
namespace {

// Estimates the average number of voxels that a triangle touches under conservative coverage, from a sample. For a
// random position this is the volume of the Minkowski sum of the triangle and a voxel: 1, plus the lengths of the
// triangle's projections onto the axes, plus the areas of its projections onto the coordinate planes.
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
  // Measured on spheres with 2 to 8 voxels per triangle: about 0.7 groups per voxel beyond the first 1.6.
  constexpr double kMaxVoxels = 12, kShared = 1.6, kBundles = .7, kLeast = .25;
  const double voxels = VoxelsOfTriangle(state), bundles = std::max(kLeast, kBundles * (voxels - kShared));
  // Fragments that fit in the L2 cache are sorted in less time than the host needs to read the number of groups.
  if (!(voxels <= kMaxVoxels) || !ExceedsCache(state.device, uint64_t(voxels * double(triangles)) * sizeof(uint32_t))) {
    return std::nullopt;
  }
  // The rest of the shared memory holds fragments that are not grouped yet, and allows for denser regions. More
  // iterations gained nothing.
  constexpr double kFilled = .65 * kBundleRoom, kMaxRounds = 4;
  plan.rounds = uint32_t(std::clamp(kFilled / (bundles * kBundledTriangles), 1., kMaxRounds));
  return plan;
}

}  // namespace voxelpipe::cuda
